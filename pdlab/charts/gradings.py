"""Grading curves."""

import math
from collections.abc import Mapping, Sequence

import plotly.graph_objects as go

from pdlab.charts.style import GRID, INK, LIMITS, LINES, Drawn, apart, made, scatter, shown
from pdlab.grading import Grading
from pdlab.quantities import label

DASHES = ("dash", "dot", "dashdot")
GAP = 0.05
"""Least distance of two sieves' labels in powers of ten: a ratio of 1.12."""
Curve = tuple[Sequence[float], Sequence[float]]
Limit = tuple[float, float, float]


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
    series, ticks = [_band(limits)] if limits else [], set[float]()
    for k, (name, (sizes, shares)) in enumerate((targets or {}).items()):
        line = {"dash": DASHES[k % len(DASHES)], "width": 1.5, "color": INK}
        passing = [100.0 * share for share in shares]
        series.append(scatter(x=list(sizes), y=passing, mode="lines", name=shown(name), line=line, hoverinfo="name"))
    for k, (raw, grading) in enumerate(gradings.items()):
        line = {"color": LINES[k % len(LINES)], "width": 2.0 if mixture is None else 1.2}
        series.append(_curve(shown(raw), grading, line))
        ticks |= set(grading.apertures)
    if mixture is not None:
        series.append(_curve("mixture", mixture, {"color": INK, "width": 4}))
    values = apart(sorted(ticks), GAP, math.log10)
    text = [f"{value:g}" for value in values]
    return made(
        series, 420, showlegend=len(gradings) > 1 or bool(targets or limits or mixture),
        legend={"orientation": "h", "y": -0.25},
        xaxis={"type": "log", "tickvals": values, "ticktext": text, "title": label("aperture"), "gridcolor": GRID},
        yaxis={"range": [-2, 102], "title": label("passing_percent"), "gridcolor": GRID},
    )  # fmt: skip


def _curve(name: str, grading: Grading, line: Drawn) -> Drawn:
    return scatter(
        x=list(grading.apertures), y=[100.0 * float(share) for share in grading.passing], mode="lines+markers",
        name=name, line=line, hovertemplate="%{x:g} mm: %{y:.1f} %<extra>" + name + "</extra>",
    )  # fmt: skip


def _band(limits: Sequence[Limit]) -> Drawn:
    """Return the band between the limits of a standard."""
    apertures = [aperture for aperture, _, _ in limits]
    highest, lowest = [high for _, _, high in limits], [low for _, low, _ in limits]
    return scatter(
        x=[*apertures, *apertures[::-1]], y=[*highest, *lowest[::-1]], mode="lines", fill="toself", fillcolor=LIMITS,
        line={"width": 0}, name="ASTM C33 fine", hoverinfo="name",
    )  # fmt: skip
