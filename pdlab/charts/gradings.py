"""Grading curves."""

import math
from collections.abc import Mapping, Sequence

import plotly.graph_objects as go

from pdlab.charts.style import GRID, INK, LIMITS, LINES, apart, shown, styled
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
    figure, ticks = go.Figure(), set[float]()
    if limits:
        _add_band(figure, limits)
    for k, (name, (sizes, shares)) in enumerate((targets or {}).items()):
        line = {"dash": DASHES[k % len(DASHES)], "width": 1.5, "color": INK}
        passing = [100.0 * share for share in shares]
        figure.add_scatter(x=list(sizes), y=passing, mode="lines", name=shown(name), line=line, hoverinfo="name")
    for k, (raw, grading) in enumerate(gradings.items()):
        line = {"color": LINES[k % len(LINES)], "width": 2.0 if mixture is None else 1.2}
        _add_grading(figure, shown(raw), grading, line)
        ticks |= set(grading.apertures)
    if mixture is not None:
        _add_grading(figure, "mixture", mixture, {"color": INK, "width": 4})
    values = apart(sorted(ticks), GAP, math.log10)
    text = [f"{value:g}" for value in values]
    figure.update_xaxes(type="log", tickvals=values, ticktext=text, title=label("aperture"), gridcolor=GRID)
    figure.update_yaxes(range=[-2, 102], title=label("passing_percent"), gridcolor=GRID)
    styled(figure, 420)
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
