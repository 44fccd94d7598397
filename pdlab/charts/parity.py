"""Parity: predicted over measured packing density."""

import base64
import itertools
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from pdlab.charts.style import BAND, GRID, INK, LINES, MARGIN, Drawn, made, scatter, shown
from pdlab.experiments import Density, Points
from pdlab.quantities import heading, label

Group = tuple[int, bool, NDArray[np.int64]]
"""The place of a method, whether its predictions are current, where they are."""
HEIGHT, SIDE = 600, 450
"""Of the figure and of the square within its axes [px]."""
LINE, BESIDE = 19, 3
"""Height of the legend's lines [px], and names in each."""
ROOM, EMPTY = 0.01, (0.5, 0.75)
"""Packing density [-] beside the outermost points; the ends of the axes without any."""
TICKS = 9
"""Marks on either axis at most; as many on both, which have the same steps then."""
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "cross", "star", "hexagon", "triangle-down")
FEW_TO_MANY = ((0.0, "#8fc1d4"), (0.5, "#2f7f9e"), (1.0, "#d1495b"))
OVER = "#f2c14e"
"""Of the edges of the bands on cells of all colours."""
CROWDED = 100
"""Points from which on they are one picture."""
DOT, SMALL, BAR = 7, 4, 0.6
"""Width of dots, of those of outdated predictions and of bars in the picture [px]."""
PALE = 0.15
"""Opacity of what is not picked, where something is."""
SCALE = 1000
"""Of the picture: its own units along either axis."""


def parity(
    points: Points, density: Density | None = None, methods: Sequence[str] = (), picked: Collection[int] = ()
) -> go.Figure:
    """Return predicted over measured packing density with both errors, the line, ±0.01 and ±0.02 bands.

    Points in the colour and symbol that their place among ``methods`` gives, hollow where the prediction is outdated;
    CROWDED or more are dots, small where it is outdated. All but those ``picked`` by their ids are pale. With a
    ``density`` squares behind them, coloured by how many predictions lie there. What a click on one tells
    (``customdata``): a prediction's id, or a cell's column, row and times.
    """
    ends = _ends(points, density)
    series = _bands(*ends)
    if density is not None:
        side = max(3.0, SIDE * density.width / (ends[1] - ends[0]))
        series += [*_outdated_cells(density, side), *_cells(density, side), *_edges(*ends)]
    known = (*methods, *(name for name in dict.fromkeys(points.method) if name not in methods))
    groups = _groups(points, known)
    predicted_now = {k for k, current, _ in groups if current}
    series += [_markers(points, at, k, picked, current or k not in predicted_now) for k, current, at in groups]
    axis = {"range": ends, "nticks": TICKS, "showgrid": True, "gridcolor": GRID, "constrain": "domain"}
    legend: Drawn = {"orientation": "h", "y": -0.14}
    pictures = list[Drawn]()
    if _is_crowded(points):
        pictures = [_picture(points, groups, ends, picked)]
        legend |= {"itemclick": False, "itemdoubleclick": False}  # the picture would stay
    named = sum(one.get("showlegend", True) for one in series)
    return made(
        series, HEIGHT + LINE * (max(named - 1, 0) // BESIDE), showlegend=True, legend=legend, images=pictures,
        xaxis={"title": label("measured"), **axis}, yaxis={"title": label("predicted"), "scaleanchor": "x", **axis},
        margin=MARGIN | {"t": 40},
    )  # fmt: skip


def _groups(points: Points, methods: Sequence[str]) -> list[Group]:
    """Return where the points of each method are, the current ones and the outdated ones."""
    place = {name: k for k, name in enumerate(methods)}
    number = np.array([place[name] for name in points.method], dtype=np.int64)
    found = [
        (k, current, np.flatnonzero((number == k) & (points.current == current)))
        for k in range(len(methods))
        for current in (True, False)
    ]
    return [group for group in found if group[2].size]


def _is_crowded(points: Points) -> bool:
    return len(points.ids) >= CROWDED


def _ends(points: Points, density: Density | None) -> tuple[float, float]:
    """Return the ends of both axes, between which all bars lie."""
    values = list[NDArray[np.floating]]()
    for middle, error in ((points.measured, points.measured_error), (points.predicted, points.expected_error)):
        values += [middle - np.nan_to_num(error), middle + np.nan_to_num(error)]
    if density is not None:
        values += [density.width * (cells + add) for cells in (density.column, density.row) for add in (0, 1)]
    together = np.concatenate(values)
    return (float(together.min()) - ROOM, float(together.max()) + ROOM) if together.size else EMPTY


def _bands(low: float, high: float) -> list[Drawn]:
    """Return the bands around the line of equal values, and the line."""
    bands = [
        _line([low, high, high, low], [low + band, high + band, high - band, low - band], width=0)
        | {"fill": "toself", "fillcolor": BAND}
        for band in (0.02, 0.01)
    ]
    return [*bands, _line([low, high], [low, high], color=INK, width=1)]


def _edges(low: float, high: float) -> list[Drawn]:
    """Return the line and the edges of the bands, over cells that hide them."""
    dashes = {0.0: "solid", 0.01: "dash", -0.01: "dash", 0.02: "dot", -0.02: "dot"}
    return [_line([low, high], [low + off, high + off], color=OVER, width=1, dash=dash) for off, dash in dashes.items()]


def _line(x: list[float], y: list[float], **line: Any) -> Drawn:
    return scatter(x=x, y=y, mode="lines", line=line, hoverinfo="skip", showlegend=False)


def _markers(points: Points, at: NDArray[np.int64], k: int, picked: Collection[int], is_named: bool) -> Drawn:
    """Return some predictions by the k-th method, all of them current or all outdated.

    Where they are crowded it is for the mouse and the legend: all but one of the marks are left to the picture.
    """
    current, ids, crowded = bool(points.current[at[0]]), points.ids[at].tolist(), _is_crowded(points)
    colour, method = LINES[k % len(LINES)], points.method[at[0]]
    symbol = SYMBOLS[k % len(SYMBOLS)] + ("" if current else "-open")
    bar = {"type": "data", "thickness": 1.2, "width": 3, "color": colour}
    bars = {
        "error_x": bar | {"array": points.measured_error[at]},
        "error_y": bar | {"array": points.expected_error[at]},
    }
    one_by_one = {"size": 10, "color": colour, "symbol": symbol, "opacity": 1.0 if current else 0.6}
    in_a_crowd = {"size": DOT if current else SMALL, "color": colour, "maxdisplayed": 1}
    return {
        "type": "scatter", "x": points.measured[at], "y": points.predicted[at], "mode": "markers",
        "name": shown(method) + _said(current), "legendgroup": method, "showlegend": is_named,
        "marker": in_a_crowd if crowded else one_by_one,
        "selectedpoints": [place for place, one in enumerate(ids) if one in picked] if picked else None,
        "unselected": {"marker": {"opacity": PALE}}, "customdata": [[one] for one in ids],
        "text": [_told(points, int(place)) for place in at], "hovertemplate": "%{text}<extra></extra>",
        **({} if crowded else bars),
    }  # fmt: skip


def _picture(points: Points, groups: Sequence[Group], ends: tuple[float, float], picked: Collection[int]) -> Drawn:
    """Return points with their bars as one picture between the axes' ends: a browser is slow with many marks.

    Strokes are as wide however far it is drawn out, so that near points come apart as in a chart of marks.
    """
    is_picked = np.isin(points.ids, list(picked)) if picked else np.ones(len(points.ids), dtype=bool)
    bars, dots = list[str](), list[str]()
    for seen, (k, current, at) in itertools.product((False, True), groups):
        some = at[is_picked[at] == seen]
        for paths, width, path in (
            (bars, BAR, _crosses(points, some, ends)), (dots, DOT if current else SMALL, _places(points, some, ends))
        ):  # fmt: skip
            opacity = (1.0 if paths is dots else 0.5) * (1.0 if seen else PALE)
            paths.append(
                f'<path stroke="{LINES[k % len(LINES)]}" stroke-width="{width}" opacity="{opacity:g}" d="{path}"/>'
            )
    style = "<style>path{fill:none;stroke-linecap:round;vector-effect:non-scaling-stroke}</style>"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SCALE} {SCALE}" preserveAspectRatio="none">'
    text = "".join([head, style, *bars, *dots, "</svg>"])
    return {
        "source": f"data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}", "layer": "above",
        "xref": "x", "yref": "y", "x": ends[0], "y": ends[1], "sizex": ends[1] - ends[0], "sizey": ends[1] - ends[0],
        "sizing": "stretch",
    }  # fmt: skip


def _places(points: Points, at: NDArray[np.int64], ends: tuple[float, float]) -> str:
    """Return a path of dots in the picture."""
    return "".join(f"M{x:.1f} {y:.1f}h0" for x, y in _in_picture(points, at, ends).tolist())


def _crosses(points: Points, at: NDArray[np.int64], ends: tuple[float, float]) -> str:
    """Return a path of error bars in the picture; one that is unknown has no length."""
    scale = SCALE / (ends[1] - ends[0])
    errors = scale * np.nan_to_num(np.stack([points.measured_error[at], points.expected_error[at]], axis=1))
    lines = np.hstack([_in_picture(points, at, ends), errors]).tolist()
    return "".join(f"M{x - w:.1f} {y:.1f}h{2 * w:.1f}M{x:.1f} {y - h:.1f}v{2 * h:.1f}" for x, y, w, h in lines)


def _in_picture(points: Points, at: NDArray[np.int64], ends: tuple[float, float]) -> NDArray[np.float64]:
    """Return where points are in the picture from its upper left corner, shape (P, 2)."""
    scale = SCALE / (ends[1] - ends[0])
    return scale * np.stack([points.measured[at] - ends[0], ends[1] - points.predicted[at]], axis=1)


def _told(points: Points, k: int) -> str:
    """Return what stands beside a point under the mouse."""
    lines = [shown(points.mixture[k]), f"by {shown(points.method[k])}{_said(bool(points.current[k]))}"]
    both = (
        ("measured", points.measured[k], points.measured_error[k]),
        ("predicted", points.predicted[k], points.expected_error[k]),
    )
    lines += [f"{name} {value:.4f}" + ("" if np.isnan(error) else f" ± {error:.4f}") for name, value, error in both]
    return "<br>".join(lines)


def _said(current: bool) -> str:
    return "" if current else ", outdated"


def _cells(density: Density, side: float) -> list[Drawn]:
    """Return the cells with predictions that are current, coloured by the logarithm of how many."""
    at = np.flatnonzero(density.current)
    counts = density.current[at]
    ticks = [value for power in range(6) for value in (10**power, 3 * 10**power) if value <= max(counts, default=1)]
    bar = {
        "title": {"text": "number", "font": {"size": 13}}, "tickvals": np.log10(ticks),
        "ticktext": [f"{one}" for one in ticks], "thickness": 12, "len": 0.6,
    }  # fmt: skip
    marker = {"symbol": "square", "size": side, "color": np.log10(counts), "colorscale": FEW_TO_MANY, "colorbar": bar}
    return _squares(density, at, counts, "predictions, by their number", marker)


def _outdated_cells(density: Density, side: float) -> list[Drawn]:
    """Return the cells of which all predictions are outdated."""
    at = np.flatnonzero(density.current == 0)
    marker = {"symbol": "square-open", "size": 0.8 * side, "color": INK}
    return _squares(density, at, density.outdated[at], "outdated ones only", marker)


def _squares(
    density: Density, at: NDArray[np.int64], counts: NDArray[np.int64], name: str, marker: Drawn
) -> list[Drawn]:
    """Return squares at some cells, none where there are none."""
    if not at.size:
        return []
    column, row = density.column[at], density.row[at]
    cells = {
        "type": "scatter", "x": density.width * (column + 0.5), "y": density.width * (row + 0.5), "mode": "markers",
        "name": name, "marker": marker,
        "customdata": [[*cell, density.times] for cell in zip(column.tolist(), row.tolist(), strict=True)],
        "text": [f"{count} prediction{'' if count == 1 else 's'}" for count in counts],
        "hovertemplate": f"%{{text}}<br>{heading('measured')} %{{x:.4f}}, {heading('predicted')} %{{y:.4f}} "
        f"± {density.width / 2.0:g}<extra></extra>",
    }  # fmt: skip
    return [cells]
