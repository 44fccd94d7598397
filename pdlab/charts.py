"""Figures from plain data."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from pdlab.experiments import DrawnBed, DrawnCurve, Explained, PredictionReport
from pdlab.grading import Grading
from pdlab.quantities import label

INK, SERIES, GRID, BAND = "#7b8794", "#3488a8", "rgba(128, 128, 128, 0.25)", "rgba(52, 136, 168, 0.18)"
"""Colours that stand on white and on black alike."""

LINES = ("#3488a8", "#d1495b", "#b08a20", "#4c9a5f", "#9568c4", "#d9822b", "#6285e0", "#a86a5a")
DASHES = ("dash", "dot", "dashdot")
LIMITS = "rgba(209, 140, 29, 0.20)"
BED_PIXELS = 420
"""Pixels that the longest side of a bed takes before it is zoomed."""
LEAST_RATIO = 1.12
"""Ratio of two sieves whose labels do not overlap."""
Curve = tuple[Sequence[float], Sequence[float]]
Limit = tuple[float, float, float]


def _styled(figure: go.Figure, height: int) -> go.Figure:
    figure.update_layout(
        template="plotly_white", height=height, showlegend=False, font={"size": 14},
        margin={"l": 10, "r": 10, "t": 20, "b": 10},
    )  # fmt: skip
    return figure


def _plain(text: str) -> str:
    """Return text that plotly shows as it stands, without its tags."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def grading_curve(
    gradings: Mapping[str, Grading],
    targets: Mapping[str, Curve] | None = None,
    limits: Sequence[Limit] = (),
    mixture: Grading | None = None,
) -> go.Figure:
    """Return percent passing over aperture, log axis with the sieves as ticks, a line for each name.

    ``targets``: sizes [mm] and shares passing [-] to compare with, by name. ``limits``: a band of aperture [mm], least
    and largest percent passing. ``mixture``: a thick line, beside which those of its parts are thin.
    """
    figure, ticks = go.Figure(), set[float]()
    if limits:
        _add_band(figure, limits)
    for k, (name, (sizes, shares)) in enumerate((targets or {}).items()):
        line = {"dash": DASHES[k % len(DASHES)], "width": 1.5, "color": INK}
        passing = [100.0 * share for share in shares]
        figure.add_scatter(x=list(sizes), y=passing, mode="lines", name=_plain(name), line=line, hoverinfo="name")
    for k, (raw, grading) in enumerate(gradings.items()):
        line = {"color": LINES[k % len(LINES)], "width": 2.0 if mixture is None else 1.2}
        _add_grading(figure, _plain(raw), grading, line)
        ticks |= set(grading.apertures)
    if mixture is not None:
        _add_grading(figure, "mixture", mixture, {"color": INK, "width": 4})
    values = _apart(sorted(ticks))
    text = [f"{value:g}" for value in values]
    figure.update_xaxes(type="log", tickvals=values, ticktext=text, title=label("aperture"), gridcolor=GRID)
    figure.update_yaxes(range=[-2, 102], title=label("passing_percent"), gridcolor=GRID)
    _styled(figure, 420)
    named = len(gradings) > 1 or bool(targets or limits or mixture)
    return figure.update_layout(showlegend=named, legend={"orientation": "h", "y": -0.25})


def _add_grading(figure: go.Figure, name: str, grading: Grading, line: Mapping[str, object]) -> None:
    figure.add_scatter(
        x=list(grading.apertures), y=[100.0 * float(share) for share in grading.passing], mode="lines+markers",
        name=name, line=dict(line), hovertemplate="%{x:g} mm: %{y:.1f} %<extra>" + name + "</extra>",
    )  # fmt: skip


def _add_band(figure: go.Figure, limits: Sequence[Limit]) -> None:
    """Draw the band between the limits of a standard."""
    apertures = [aperture for aperture, _, _ in limits]
    highest, lowest = [high for _, _, high in limits], [low for _, low, _ in limits]
    figure.add_scatter(
        x=[*apertures, *apertures[::-1]], y=[*highest, *lowest[::-1]], mode="lines", fill="toself", fillcolor=LIMITS,
        line={"width": 0}, name="ASTM C33 fine", hoverinfo="name",
    )  # fmt: skip


def _apart(values: Sequence[float]) -> list[float]:
    """Return the rising sieves of which each is far enough from the last on the axis to be labelled."""
    out = list[float]()
    for value in values:
        if not out or value >= LEAST_RATIO * out[-1]:
            out.append(value)
    return out


def parity(reports: Sequence[PredictionReport]) -> go.Figure:
    """Return predicted over measured packing density with both errors, the line, ±0.01 and ±0.02 bands."""
    shown = [report for report in reports if report.packing_density is not None and report.measured is not None]
    values = [value for report in shown for value in (report.packing_density or 0.0, report.measured or 0.0)]
    low, high = (min(values) - 0.04, max(values) + 0.04) if values else (0.5, 0.75)
    figure = go.Figure()
    for band in (0.02, 0.01):
        figure.add_scatter(
            x=[low, high, high, low], y=[low + band, high + band, high - band, low - band],
            mode="lines", fill="toself", fillcolor=BAND, line={"width": 0}, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter(x=[low, high], y=[low, high], mode="lines", line={"color": INK, "width": 1}, hoverinfo="skip")
    figure.add_scatter(
        x=[report.measured for report in shown],
        y=[report.packing_density for report in shown],
        error_x={"type": "data", "array": [report.measured_error for report in shown], "thickness": 1.2},
        error_y={"type": "data", "array": [report.expected_error for report in shown], "thickness": 1.2},
        mode="markers", marker={"size": 10, "color": SERIES},
        text=[_plain(report.mixture) for report in shown],
        hovertemplate="%{text}<br>measured %{x:.4f}<br>predicted %{y:.4f}<extra></extra>",
    )  # fmt: skip
    figure.update_xaxes(range=[low, high], title=label("measured"), gridcolor=GRID, constrain="domain")
    figure.update_yaxes(range=[low, high], title=label("predicted"), gridcolor=GRID, scaleanchor="x")
    return _styled(figure, 520)


def calibration_curve(known: Explained, curve: DrawnCurve) -> go.Figure:
    """Return what is sought over the coefficient, spaced by its root: curve ± error, runs, nodes, what is measured.

    The measured value ± its error lies across, the coefficient's interval upright.
    """
    figure = go.Figure()
    x = [float(root) for root in np.sqrt(curve.values)]
    high = [mean + error for mean, error in zip(curve.means, curve.errors, strict=True)]
    low = [mean - error for mean, error in zip(curve.means, curve.errors, strict=True)]
    figure.add_scatter(x=[*x, *x[::-1]], y=[*high, *low[::-1]], mode="lines", fill="toself", fillcolor=BAND,
                       line={"width": 0}, hoverinfo="skip", name="± curve", showlegend=False)  # fmt: skip
    figure.add_scatter(x=x, y=list(curve.means), mode="lines", line={"color": SERIES}, name="curve", hoverinfo="skip")
    figure.add_scatter(
        x=[float(np.sqrt(node.value)) for node in curve.nodes], y=[node.mean for node in curve.nodes], mode="markers",
        error_y={"type": "data", "array": [node.deviation for node in curve.nodes]}, name="mean ± deviation",
        marker={"size": 8, "color": SERIES}, customdata=[[node.value, len(node.runs)] for node in curve.nodes],
        hovertemplate="%{customdata[0]:g}: %{y:.4f}, %{customdata[1]} runs<extra></extra>",
    )  # fmt: skip
    runs = [(float(np.sqrt(node.value)), run) for node in curve.nodes for run in node.runs]
    figure.add_scatter(x=[at for at, _ in runs], y=[run for _, run in runs], mode="markers", name="runs",
                       marker={"size": 5, "color": LINES[5], "opacity": 0.7})  # fmt: skip
    _add_measured(figure, known)
    nodes = _apart_by([node.value for node in curve.nodes])
    figure.update_xaxes(tickvals=list(np.sqrt(nodes)), ticktext=[f"{value:g}" for value in nodes],
                        title=label(curve.coefficient), gridcolor=GRID)  # fmt: skip
    figure.update_yaxes(title=label(curve.sought), gridcolor=GRID)
    return _styled(figure, 460).update_layout(showlegend=True, legend={"orientation": "h", "y": -0.22})


def _add_measured(figure: go.Figure, known: Explained) -> None:
    """Draw what was measured, and where the curve meets it."""
    if known.measured is not None and known.measured_error is not None:
        figure.add_hrect(known.measured - known.measured_error, known.measured + known.measured_error,
                         fillcolor=LIMITS, line_width=0)  # fmt: skip
        figure.add_hline(known.measured, line={"color": LINES[5], "dash": "dash"}, annotation_text="measured")
    if known.value is not None:
        ends = [known.value if end is None else end for end in (known.low, known.high)]
        figure.add_vrect(*(float(np.sqrt(end)) for end in ends), fillcolor=BAND, line_width=0)
        figure.add_vline(float(np.sqrt(known.value)), line={"color": INK, "dash": "dot"})


def bed(drawn: DrawnBed) -> go.Figure:
    """Return a bed's spheres in three dimensions, coloured by aggregate, lengths in mm with one scale for all axes.

    The markers' diameters are in the proportions of the spheres; they do not grow when the view is zoomed.
    """
    figure = go.Figure()
    extent = float(np.ptp(drawn.place[:, :3], axis=0).max() + 2.0 * drawn.place[:, 3].max())
    for k, name in enumerate(drawn.names):
        x, y, z, radius = drawn.place[drawn.part == k].T
        figure.add_scatter3d(
            x=x, y=y, z=z, mode="markers", name=_plain(name), customdata=2.0 * radius,
            marker={"size": BED_PIXELS * 2.0 * radius / extent, "sizemode": "diameter", "opacity": 1.0,
                    "color": LINES[k % len(LINES)], "line": {"width": 0}},
            hovertemplate="Ø %{customdata:.3g} mm<extra>" + _plain(name) + "</extra>",
        )  # fmt: skip
    axes = {f"{axis}axis": {"title": f"{axis} [mm]", "gridcolor": GRID} for axis in "xyz"}
    view = {"eye": {"x": 0.4, "y": -2.0, "z": 0.6}, "projection": {"type": "orthographic"}}
    figure.update_layout(scene={"aspectmode": "data", "camera": view, **axes})
    return _styled(figure, 640).update_layout(showlegend=True, legend={"orientation": "h", "itemsizing": "constant"})


def _apart_by(values: Sequence[float]) -> list[float]:
    """Return the nodes whose labels do not overlap on an axis spaced by the root."""
    out = list[float]()
    for value in values:
        if not out or np.sqrt(value) - np.sqrt(out[-1]) >= 0.07:
            out.append(value)
    return out
