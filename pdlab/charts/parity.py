"""Parity: predicted over measured packing density."""

import itertools
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from pdlab.charts.style import BAND, GRID, INK, LINES, shown, styled
from pdlab.experiments import Density, Points
from pdlab.quantities import heading, label

Drawn = dict[str, Any]
"""A series or a shape of a figure, as plotly reads it."""
HEIGHT, SIDE = 600, 450
"""Of the figure and of the square within its axes [px]."""
LINE, BESIDE = 19, 3
"""Height of the legend's lines [px], and names in each."""
MARGIN, EMPTY = 0.01, (0.5, 0.75)
"""Packing density [-] beside the outermost points; the ends of the axes without any."""
TICKS = (0.01, 0.02, 0.05, 0.1)
"""Steps of both axes [-]."""
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "cross", "star", "hexagon", "triangle-down")
FEW_TO_MANY = ((0.0, "#8fc1d4"), (0.5, "#2f7f9e"), (1.0, "#d1495b"))
OVER = "#f2c14e"
"""Of the edges of the bands on cells of all colours."""
CROWDED = 60
"""Points from which on they and their bars are thin."""


def parity(
    points: Points, density: Density | None = None, methods: Sequence[str] = (), picked: Collection[int] = ()
) -> go.Figure:
    """Return predicted over measured packing density with both errors, the line, ±0.01 and ±0.02 bands.

    Points in the colour and symbol that their place among ``methods`` gives; hollow where the prediction is outdated;
    all but those ``picked`` by their ids are pale. With a ``density`` squares behind them, coloured by how many
    predictions lie there. What a click on one tells (``customdata``): a prediction's id, or a cell's column, row and
    times.
    """
    ends = _ends(points, density)
    series, bars = _bands(*ends), list[Drawn]()
    if density is not None:
        side = max(3.0, SIDE * density.width / (ends[1] - ends[0]))
        series += [*_outdated_cells(density, side), *_cells(density, side), *_edges(*ends)]
    known = (*methods, *(name for name in dict.fromkeys(points.method) if name not in methods))
    place = {name: k for k, name in enumerate(known)}
    number = np.array([place[name] for name in points.method], dtype=np.int64)
    crowded = len(points.ids) >= CROWDED
    for k, current in itertools.product(range(len(known)), (True, False)):
        at = np.flatnonzero((number == k) & (points.current == current))
        if at.size:
            is_named = current or not (points.current & (number == k)).any()
            series.append(_markers(points, at, k, picked, is_named))
            if crowded:
                bars.append(_bars(points, at, LINES[k % len(LINES)]))
    apart = next((step for step in TICKS if ends[1] - ends[0] <= 9.0 * step), TICKS[-1])
    axis = {"range": ends, "dtick": apart, "showgrid": True, "gridcolor": GRID, "constrain": "domain"}
    layout = {
        "xaxis": {"title": {"text": label("measured")}, **axis},
        "yaxis": {"title": {"text": label("predicted")}, "scaleanchor": "x", **axis}, "shapes": bars,
    }  # fmt: skip
    named = sum(one.get("showlegend", True) for one in series)
    figure = go.Figure(series, layout)  # all at once: one by one each is checked and copied several times
    styled(figure, HEIGHT + LINE * (max(named - 1, 0) // BESIDE))
    return figure.update_layout(showlegend=True, legend={"orientation": "h", "y": -0.14}, margin_t=40)


def _ends(points: Points, density: Density | None) -> tuple[float, float]:
    """Return the ends of both axes, between which all bars lie."""
    values = list[NDArray[np.floating]]()
    for middle, error in ((points.measured, points.measured_error), (points.predicted, points.expected_error)):
        values += [middle - np.nan_to_num(error), middle + np.nan_to_num(error)]
    if density is not None:
        values += [density.width * (cells + add) for cells in (density.column, density.row) for add in (0, 1)]
    together = np.concatenate(values)
    return (float(together.min()) - MARGIN, float(together.max()) + MARGIN) if together.size else EMPTY


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
    return {"type": "scatter", "x": x, "y": y, "mode": "lines", "line": line, "hoverinfo": "skip", "showlegend": False}


def _markers(points: Points, at: NDArray[np.int64], k: int, picked: Collection[int], is_named: bool) -> Drawn:
    """Return some predictions by the k-th method, all of them current or all outdated."""
    current, ids, crowded = bool(points.current[at[0]]), points.ids[at].tolist(), len(points.ids) >= CROWDED
    colour, method = LINES[k % len(LINES)], points.method[at[0]]
    symbol = SYMBOLS[k % len(SYMBOLS)] + ("" if current else "-open")
    bar = {"type": "data", "thickness": 1.2, "width": 3, "color": colour}
    bars = {
        "error_x": bar | {"array": points.measured_error[at]},
        "error_y": bar | {"array": points.expected_error[at]},
    }
    return {
        "type": "scatter", "x": points.measured[at], "y": points.predicted[at], "mode": "markers",
        "name": shown(method) + _said(current), "legendgroup": method, "showlegend": is_named,
        "marker": {
            "size": 7 if crowded else 10, "color": colour, "symbol": symbol, "opacity": 1.0 if current else 0.6
        },
        "selectedpoints": [place for place, one in enumerate(ids) if one in picked] if picked else None,
        "unselected": {"marker": {"opacity": 0.15}}, "customdata": [[one] for one in ids],
        "text": [_told(points, int(place)) for place in at], "hovertemplate": "%{text}<extra></extra>",
        **({} if crowded else bars),
    }  # fmt: skip


def _bars(points: Points, at: NDArray[np.int64], colour: str) -> Drawn:
    """Return the error bars of many points as one shape, which a browser draws at once."""
    x, y = points.measured[at], points.predicted[at]
    wide, high = np.nan_to_num(points.measured_error[at]), np.nan_to_num(points.expected_error[at])
    ends = np.stack([x - wide, y, x + wide, y, x, y - high, x, y + high], axis=1)
    path = "".join("M{:.5f},{:.5f}L{:.5f},{:.5f}M{:.5f},{:.5f}L{:.5f},{:.5f}".format(*row) for row in ends.tolist())
    return {"type": "path", "path": path, "line": {"width": 0.6, "color": colour}, "layer": "between"}


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
