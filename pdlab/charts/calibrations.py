"""The curve that a calibration rests on."""

import math

import numpy as np
import plotly.graph_objects as go

from pdlab.charts.style import BAND, GRID, INK, LIMITS, LINES, SERIES, Drawn, apart, made, scatter
from pdlab.experiments import DrawnCurve, Explained
from pdlab.quantities import label

GAP = 0.07
"""Least distance of two nodes' labels in roots of the coefficient."""
AIMED, FOUND = {"color": LINES[5], "dash": "dash"}, {"color": INK, "dash": "dot"}


def calibration_curve(known: Explained, curve: DrawnCurve) -> go.Figure:
    """Return what is sought over the coefficient, spaced by its root: curve ± error, runs, nodes, what is measured.

    The measured value ± its error lies across, the coefficient's interval upright.
    """
    x = [float(root) for root in np.sqrt(curve.values)]
    high = [mean + error for mean, error in zip(curve.means, curve.errors, strict=True)]
    low = [mean - error for mean, error in zip(curve.means, curve.errors, strict=True)]
    runs = [(float(np.sqrt(node.value)), run) for node in curve.nodes for run in node.runs]
    series = [
        scatter(x=[*x, *x[::-1]], y=[*high, *low[::-1]], mode="lines", fill="toself", fillcolor=BAND,
                line={"width": 0}, hoverinfo="skip", name="± curve", showlegend=False),
        scatter(x=x, y=list(curve.means), mode="lines", line={"color": SERIES}, name="curve", hoverinfo="skip"),
        scatter(
            x=[float(np.sqrt(node.value)) for node in curve.nodes], y=[node.mean for node in curve.nodes],
            mode="markers", error_y={"type": "data", "array": [node.deviation for node in curve.nodes]},
            name="mean ± deviation", marker={"size": 8, "color": SERIES},
            customdata=[[node.value, len(node.runs)] for node in curve.nodes],
            hovertemplate="%{customdata[0]:g}: %{y:.4f}, %{customdata[1]} runs<extra></extra>",
        ),
        scatter(x=[at for at, _ in runs], y=[run for _, run in runs], mode="markers", name="runs",
                marker={"size": 5, "color": LINES[5], "opacity": 0.7}),
    ]  # fmt: skip
    nodes = apart([node.value for node in curve.nodes], GAP, math.sqrt)
    shapes, notes = _measured(known)
    return made(
        series, 460, showlegend=True, legend={"orientation": "h", "y": -0.22}, shapes=shapes, annotations=notes,
        xaxis={"tickvals": list(np.sqrt(nodes)), "ticktext": [f"{value:g}" for value in nodes],
               "title": label(curve.coefficient), "gridcolor": GRID},
        yaxis={"title": label(curve.sought), "gridcolor": GRID},
    )  # fmt: skip


def _measured(known: Explained) -> tuple[list[Drawn], list[Drawn]]:
    """Return what was measured, and where the curve meets it, as shapes and annotations."""
    shapes, notes = list[Drawn](), list[Drawn]()
    if known.measured is not None and known.measured_error is not None:
        ends = (known.measured - known.measured_error, known.measured + known.measured_error)
        shapes += [
            _across(*ends, fillcolor=LIMITS, line={"width": 0}),
            _across(known.measured, known.measured, line=AIMED),
        ]
        notes.append({"text": "measured", "x": 1, "xref": "x domain", "xanchor": "right", "y": known.measured,
                      "yanchor": "bottom", "showarrow": False})  # fmt: skip
    if known.value is not None:
        low, at, high = (float(np.sqrt(known.value if end is None else end)) for end in (known.low, None, known.high))
        shapes += [_upright(low, high, fillcolor=BAND, line={"width": 0}), _upright(at, at, line=FOUND)]
    return shapes, notes


def _across(low: float, high: float, **style: object) -> Drawn:
    """Return a band between two values, or a line, over the whole width."""
    return {"type": "rect", "x0": 0, "x1": 1, "xref": "x domain", "y0": low, "y1": high, **style}


def _upright(low: float, high: float, **style: object) -> Drawn:
    """Return the same between two places, over the whole height."""
    return {"type": "rect", "y0": 0, "y1": 1, "yref": "y domain", "x0": low, "x1": high, **style}
