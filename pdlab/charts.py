"""Figures from plain data."""

from collections.abc import Sequence

import plotly.graph_objects as go

from pdlab.experiments import PredictionReport
from pdlab.grading import Grading
from pdlab.quantities import label

INK, SERIES, GRID, BAND = "#1f2933", "#1f6f8b", "#d9dee3", "rgba(31, 111, 139, 0.10)"


def _styled(figure: go.Figure, height: int) -> go.Figure:
    figure.update_layout(
        template="plotly_white", height=height, showlegend=False, font={"color": INK, "size": 14},
        margin={"l": 10, "r": 10, "t": 20, "b": 10},
    )  # fmt: skip
    return figure


def _plain(text: str) -> str:
    """Return text that plotly shows as it stands, without its tags."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def grading_curve(gradings: dict[str, Grading]) -> go.Figure:
    """Return percent passing over aperture, log axis with the sieves as ticks, a line for each name."""
    figure = go.Figure()
    ticks = set[float]()
    for raw, grading in gradings.items():
        name = _plain(raw)
        passing = [100.0 * float(share) for share in grading.passing]
        ticks |= set(grading.apertures)
        figure.add_scatter(
            x=list(grading.apertures), y=passing, mode="lines+markers", name=name,
            hovertemplate="%{x:g} mm: %{y:.1f} %<extra>" + name + "</extra>",
        )  # fmt: skip
    values = sorted(ticks)
    text = [f"{value:g}" for value in values]
    figure.update_xaxes(type="log", tickvals=values, ticktext=text, title=label("aperture"), gridcolor=GRID)
    figure.update_yaxes(range=[-2, 102], title=label("passing_percent"), gridcolor=GRID)
    _styled(figure, 360)
    if len(gradings) == 1:
        figure.update_traces(line_color=SERIES)
    return figure.update_layout(showlegend=len(gradings) > 1)


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
