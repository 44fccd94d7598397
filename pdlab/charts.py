"""Figures from plain data."""

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from scipy.spatial import ConvexHull

from pdlab.experiments import DrawnBed, DrawnCurve, Explained, PredictionReport
from pdlab.grading import Grading
from pdlab.quantities import label

INK, SERIES, GRID, BAND = "#7b8794", "#3488a8", "rgba(128, 128, 128, 0.25)", "rgba(52, 136, 168, 0.18)"
"""Colours that stand on white and on black alike."""

LINES = ("#3488a8", "#d1495b", "#b08a20", "#4c9a5f", "#9568c4", "#d9822b", "#6285e0", "#a86a5a")
DASHES = ("dash", "dot", "dashdot")
LIMITS = "rgba(209, 140, 29, 0.20)"
CORNERS = 42
"""Corners of a ball that is drawn."""
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
    """Return a bed's spheres in three dimensions, coloured by aggregate, lengths in mm with one scale for all axes."""
    figure, (points, faces) = go.Figure(), _ball()
    centre, radius = drawn.place[:, :3], drawn.place[:, 3:]
    for k, name in enumerate(drawn.names):
        own = drawn.part == k
        corners = centre[own, None] + radius[own, None] * points
        meshed = faces + len(points) * np.arange(own.sum())[:, None, None]
        x, y, z = corners.reshape(-1, 3).T.astype(np.float32)
        i, j, of = meshed.reshape(-1, 3).T.astype(np.int32)
        figure.add_mesh3d(
            x=x, y=y, z=z, i=i, j=j, k=of, name=_plain(name), color=LINES[k % len(LINES)], showlegend=True,
            hoverinfo="name", lighting={"ambient": 0.45, "diffuse": 0.7, "specular": 0.1},
            lightposition={"x": -1000, "y": -3000, "z": 3000},
        )  # fmt: skip
    low, high = (centre - radius).min(axis=0), (centre + radius).max(axis=0)
    axes = {
        f"{axis}axis": {"title": f"{axis} [mm]", "gridcolor": GRID, "range": [float(low[n]), float(high[n])]}
        for n, axis in enumerate("xyz")
    }
    longest = float((high - low).max())
    ratio = {axis: float(high[n] - low[n]) / longest for n, axis in enumerate("xyz")}
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "aspectratio": ratio,
            "camera": {"eye": {"x": 0.45, "y": -1.35, "z": 0.35}},
            **axes,
        }
    )
    return _styled(figure, 680).update_layout(showlegend=True, legend={"orientation": "h"})


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Return corners of a unit ball, shape (42, 3), evenly by the golden angle, and its triangles, all seen outside."""
    number = np.arange(CORNERS)
    height, angle = 1.0 - (2.0 * number + 1.0) / CORNERS, number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    points = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    faces = ConvexHull(points).simplices
    a, b, c = (points[faces[:, n]] for n in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces


def _apart_by(values: Sequence[float]) -> list[float]:
    """Return the nodes whose labels do not overlap on an axis spaced by the root."""
    out = list[float]()
    for value in values:
        if not out or np.sqrt(value) - np.sqrt(out[-1]) >= 0.07:
            out.append(value)
    return out
