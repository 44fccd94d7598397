"""Parity: predicted over measured packing density."""

from collections.abc import Sequence

import plotly.graph_objects as go

from pdlab.charts.style import BAND, GRID, INK, SERIES, shown, styled
from pdlab.experiments import PredictionReport
from pdlab.quantities import label


def parity(reports: Sequence[PredictionReport]) -> go.Figure:
    """Return predicted over measured packing density with both errors, the line, ±0.01 and ±0.02 bands."""
    both = [report for report in reports if report.packing_density is not None and report.measured is not None]
    values = [value for report in both for value in (report.packing_density or 0.0, report.measured or 0.0)]
    low, high = (min(values) - 0.04, max(values) + 0.04) if values else (0.5, 0.75)
    figure = go.Figure()
    for band in (0.02, 0.01):
        figure.add_scatter(
            x=[low, high, high, low], y=[low + band, high + band, high - band, low - band],
            mode="lines", fill="toself", fillcolor=BAND, line={"width": 0}, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter(x=[low, high], y=[low, high], mode="lines", line={"color": INK, "width": 1}, hoverinfo="skip")
    figure.add_scatter(
        x=[report.measured for report in both],
        y=[report.packing_density for report in both],
        error_x={"type": "data", "array": [report.measured_error for report in both], "thickness": 1.2},
        error_y={"type": "data", "array": [report.expected_error for report in both], "thickness": 1.2},
        mode="markers", marker={"size": 10, "color": SERIES},
        text=[shown(report.mixture) for report in both],
        hovertemplate="%{text}<br>measured %{x:.4f}<br>predicted %{y:.4f}<extra></extra>",
    )  # fmt: skip
    figure.update_xaxes(range=[low, high], title=label("measured"), gridcolor=GRID, constrain="domain")
    figure.update_yaxes(range=[low, high], title=label("predicted"), gridcolor=GRID, scaleanchor="x")
    return styled(figure, 520)
