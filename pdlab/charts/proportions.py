"""PD over proportions: along two aggregates, over the triangle of three, with so much of each of several."""

import itertools
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial.distance import cdist

from pdlab.charts.style import BAND, GRID, INK, LINES, SERIES, Drawn, made, scatter, shown
from pdlab.experiments import Proportions
from pdlab.quantities import heading, label
from pdlab.sweep import Densest, Swept

Floats = NDArray[np.float64]
CORNERS = np.array([[0.5, math.sqrt(0.75)], [0.0, 0.0], [1.0, 0.0]])
"""Places of the three aggregates alone: the first on top, the second to the left, the third to the right."""
ROWS = 40
"""Rows of the grid on which the triangle's PD is drawn; the ends of each lie on the triangle's sides."""
TICKS = (0.2, 0.4, 0.6, 0.8)
"""Shares [-] at which the triangle has lines."""
ISO_LINES = 8
"""About so many lines of equal PD."""
SCALE = ((0.0, "#2a2f5e"), (0.5, "#2f6f8a"), (1.0, "#3f9b6b"))
"""From loose to dense; dark enough for white letters at both ends."""
SHADOW = ", ".join(["0 0 3px #22405f"] * 4)
"""Behind white letters on a line."""
THIN = "rgba(255, 255, 255, 0.6)"
INSIDE = 0.07
"""Of each aggregate there is at least this share [-] where a line of equal PD is labelled: a label cut is none."""
AWAY = 0.015
"""Of the percent labels from their sides, in lengths of a side."""
BESIDE = ("middle left", "bottom center", "middle right")
"""Where the percent labels lie beside their sides."""
ANCHORS = ("center", "left", "right")
DASHES = ("dash", "dot")
WIDTH = 20
"""Letters of a name in one line at a corner."""


@dataclass(frozen=True)
class Marks:
    """Mixes that are marked alike: ``shares`` [-], shape (N, S), their PD [-] with its errors, what they are called."""

    name: str
    shares: Floats
    values: Floats
    errors: Floats
    titles: tuple[str, ...]
    symbol: str
    color: str
    size: int

    def texts(self, names: Sequence[str]) -> list[str]:
        """Return what is said of each: its title, shares and PD."""
        return [
            f"{title}<br>{_mix(names, row)}<br>PD {value:.4f} ± {error:.4f}"
            for title, row, value, error in zip(self.titles, self.shares, self.values, self.errors, strict=True)
        ]


def share_curve(known: Proportions, result: Swept) -> go.Figure:
    """Return PD over the share of the first of two aggregates: mean ± deviation of the beds, beds, theory, tests.

    The densest mix has the interval of its share, and both errors of its PD.
    """
    x, mean = 100.0 * result.shares[:, 0], result.packing_density
    high, low = mean + result.deviation, mean - result.deviation
    series = [
        scatter(x=[*x, *x[::-1]], y=[*high, *low[::-1]], mode="lines", fill="toself", fillcolor=BAND,
                line={"width": 0}, hoverinfo="skip", name="± beds", showlegend=False),
        scatter(x=x, y=mean, mode="lines", line={"color": SERIES}, name="simulated ± beds",
                hovertemplate="%{x:.4g} %: %{y:.4f}<extra></extra>"),
    ]  # fmt: skip
    for dash, (name, values) in zip(DASHES, known.theories.items(), strict=False):
        line = {"color": INK, "width": 1.2, "dash": dash}
        series.append(scatter(x=x, y=values, mode="lines", name=heading(name), hoverinfo="name", line=line))
    for marks in _marks(known, result):
        series.append(
            scatter(
                x=100.0 * marks.shares[:, 0], y=marks.values, mode="markers", name=marks.name,
                error_y={"type": "data", "array": marks.errors, "thickness": 1.2},
                marker={"symbol": marks.symbol, "size": marks.size, "color": marks.color},
                text=marks.texts(known.names), hovertemplate="%{text}<extra></extra>",
            )
        )  # fmt: skip
    best = result.densest
    series[-1]["error_x"] = {
        "type": "data", "symmetric": False, "array": [100.0 * (best.high[0] - best.shares[0])],
        "arrayminus": [100.0 * (best.shares[0] - best.low[0])], "thickness": 2,
    }  # fmt: skip
    return _over_share(series, f"{shown(known.names[0])} [% of solid volume]")


def _over_share(series: list[Drawn], title: str) -> go.Figure:
    """Return series of PD over a share in percent as a figure."""
    return made(
        series, 500, showlegend=True, legend={"orientation": "h", "y": -0.2},
        xaxis={"title": title, "range": [-3, 103], "gridcolor": GRID},
        yaxis={"title": label("packing_density"), "gridcolor": GRID},
    )  # fmt: skip


def _marks(known: Proportions, result: Swept) -> list[Marks]:
    """Return what is marked among the proportions, the densest mix last."""
    best, test, out = result.densest, result.next_test, list[Marks]()
    bed = tuple("one bed" for _ in result.points)
    beds = [(point.shares, point.packing_density, point.standard_error) for point in result.points]
    out += _of("beds", beds, bed, "circle", SERIES, 7)
    for name, mixes, symbol in (("measured alone", known.alone, "square"), ("measured", known.measured, "diamond")):
        rows = [(mix.shares, mix.packing_density, mix.standard_error) for mix in mixes]
        out += _of(name, rows, tuple(f"{shown(mix.name)}, measured" for mix in mixes), symbol, LINES[1], 9)
    if test is not None:
        row = (test.shares, test.packing_density, test.error)
        out += _of("to test next", [row], ("to test next",), "triangle-up", LINES[4], 13)
    row = (best.shares, best.packing_density, math.hypot(best.standard_error, best.input_error))
    return out + _of("densest mix", [row], ("densest mix, ± simulation and inputs",), "star", LINES[5], 16)


def _of(
    name: str, rows: Sequence[tuple[tuple[float, ...], float, float]], titles: tuple[str, ...], symbol: str, color: str,
    size: int,
) -> list[Marks]:  # fmt: skip
    """Return marks of mixes, each its shares, PD and error; none of no mixes."""
    if not rows:
        return []
    shares, values, errors = (np.array(column, dtype=np.float64) for column in zip(*rows, strict=True))
    return [Marks(name, shares, values, errors, titles, symbol, color, size)]


def _mix(names: Sequence[str], shares: Sequence[float] | Floats) -> str:
    """Return the shares of a mix in percent, a line for each aggregate."""
    return "<br>".join(f"{shown(name)} {100.0 * share:.4g} %" for name, share in zip(names, shares, strict=True))


def places(shares: ArrayLike) -> Floats:
    """Return where proportions of three aggregates lie in the triangle of side 1, shape (M, 2), from (M, 3)."""
    return np.asarray(np.asarray(shares, dtype=np.float64) @ CORNERS, dtype=np.float64)


def triangle_grid(shares: Floats, values: Floats, rows: int = ROWS) -> tuple[Floats, Floats, Floats]:
    """Return x, shape (2 R + 1,), y, shape (R + 1,), and values, shape (R + 1, 2 R + 1), NaN outside the triangle.

    From values at ``shares``, shape (M, 3), by the piecewise cubic surface of Clough and Tocher (1965).
    """
    x, y = np.arange(2 * rows + 1) / (2 * rows), np.arange(rows + 1) / rows * CORNERS[0, 1]
    number, row = np.meshgrid(np.arange(2 * rows + 1), np.arange(rows + 1))
    inside = (number >= row) & (number <= 2 * rows - row)
    points = np.stack([x[number[inside]], y[row[inside]]], axis=1)
    middle = CORNERS.mean(axis=0)
    points = middle + (1.0 - 1e-9) * (points - middle)  # on the sides rounding must not put them outside
    out = np.full(inside.shape, np.nan)
    out[inside] = CloughTocher2DInterpolator(places(shares), values)(points)
    return x, y, out


def proportion_triangle(known: Proportions, result: Swept) -> go.Figure:
    """Return PD over the proportions of three aggregates as a triangle with lines of equal PD, beds and tests.

    The polygon around the densest mix holds the proportions within the intervals of its shares.
    """
    marked, around = _marks(known, result), places(interval_corners(result.densest))
    series = [
        *_surface(known.names, result, places(np.concatenate([marks.shares for marks in marked]))),
        *_scales(len(known.names)),
        scatter(x=around[:, 0], y=around[:, 1], mode="lines", line={"color": LINES[5], "width": 2},
                hoverinfo="skip", name="densest mix, its interval"),
    ]  # fmt: skip
    for marks in marked:
        at = places(marks.shares)
        series.append(
            scatter(
                x=at[:, 0], y=at[:, 1], mode="markers", name=marks.name, text=marks.texts(known.names),
                marker={"symbol": marks.symbol, "size": marks.size, "color": marks.color,
                        "line": {"color": "white", "width": 1}},
                hovertemplate="%{text}<extra></extra>",
            )
        )  # fmt: skip
    return made(
        series, 680, showlegend=True, legend={"orientation": "h", "y": -0.02}, annotations=_corners(known.names),
        xaxis={"visible": False, "range": [-0.12, 1.12], "constrain": "domain"},
        yaxis={"visible": False, "range": [-0.14, CORNERS[0, 1] + 0.1], "scaleanchor": "x"},
    )  # fmt: skip


def _surface(names: Sequence[str], result: Swept, marked: Floats) -> list[Drawn]:
    """Return the areas between lines of equal PD, and what is said at each place of the sweep's grid.

    ``marked``: places, shape (K, 2), which the labels of the lines leave free.
    """
    x, y, values = triangle_grid(result.shares, result.packing_density)
    step = _step(float(np.ptp(result.packing_density)))
    first, last = math.ceil(np.nanmin(values) / step), math.floor(np.nanmax(values) / step)
    lines = level_places([step * k for k in range(first, last + 1)], (x, y, values), marked)
    at = places(result.shares)
    texts = [
        f"{_mix(names, row)}<br>PD {value:.4f} ± {error:.4f}"
        for row, value, error in zip(result.shares, result.packing_density, result.deviation, strict=True)
    ]
    return [
        {
            "type": "contour", "x": x, "y": y, "z": values.astype(np.float32), "colorscale": SCALE, "hoverinfo": "skip",
            "line": {"color": THIN, "width": 1},
            "contours": {"start": step * first, "end": float(np.nanmax(values)), "size": step},
            "colorbar": {"title": {"text": label("packing_density"), "side": "top"}, "orientation": "h", "y": 1.0,
                         "yanchor": "bottom", "thickness": 12, "len": 0.5},
        },
        scatter(
            x=[at[0] for at in lines.values()], y=[at[1] for at in lines.values()], mode="text", hoverinfo="skip",
            text=[f"{level:.4g}" for level in lines], textfont={"color": "white", "size": 12, "shadow": SHADOW},
            showlegend=False, name="lines of equal PD",
        ),
        scatter(x=at[:, 0], y=at[:, 1], mode="markers", marker={"size": 10, "opacity": 0.0, "maxdisplayed": 1},
                text=texts, hovertemplate="%{text}<extra></extra>", showlegend=False, name="proportions"),
    ]  # fmt: skip


def level_places(levels: Sequence[float], grid: tuple[Floats, Floats, Floats], taken: Floats) -> dict[float, Floats]:
    """Return where each line of equal PD is labelled, shape (2,): on it, off the sides, farthest from what is taken.

    ``grid``: as ``triangle_grid`` returns it. ``taken``: places, shape (K, 2). A line at the sides alone has no label.
    """
    x, y, values = grid
    out = dict[float, Floats]()
    for level in levels:
        left, right = values[:, :-1] - level, values[:, 1:] - level
        row, column = np.nonzero(left * right < 0.0)  # outside, NaN is not less
        part = left[row, column] / (left[row, column] - right[row, column])
        at = np.stack([x[column] + part * (x[1] - x[0]), y[row]], axis=1)
        top = at[:, 1] / CORNERS[0, 1]
        third = at[:, 0] - 0.5 * top
        at = at[np.min([top, third, 1.0 - top - third], axis=0) >= INSIDE]
        if len(at):
            out[level] = at[np.argmax(cdist(at, taken).min(axis=1))]
            taken = np.concatenate([taken, out[level][None]])
    return out


def _step(span: float) -> float:
    """Return the round step of PD between lines of equal PD."""
    power = 10.0 ** math.floor(math.log10(max(span, 1e-6) / ISO_LINES))
    return min((factor * power for factor in (1.0, 2.0, 5.0, 10.0)), key=lambda one: abs(span / one - ISO_LINES))


def interval_corners(best: Densest) -> Floats:
    """Return the proportions around those within all intervals of the densest mix of three, closed, shape (N, 3)."""
    found = list[tuple[float, ...]]()
    for free in range(3):
        one, two = (k for k in range(3) if k != free)
        ends = itertools.product((best.low[one], best.high[one]), (best.low[two], best.high[two]))
        for first, second in ends:
            rest = 1.0 - first - second
            if best.low[free] - 1e-9 <= rest <= best.high[free] + 1e-9:
                row = dict(zip((one, two, free), (first, second, rest), strict=True))
                found.append(tuple(row[k] for k in range(3)))
    corners = np.unique(np.round(np.array(found).reshape(-1, 3), 9), axis=0)
    angle = np.arctan2(*(places(corners) - places(corners).mean(axis=0)).T) if len(corners) else np.empty(0)
    corners = corners[np.argsort(angle)]
    return np.asarray(np.concatenate([corners, corners[:1]]), dtype=np.float64)


def _scales(count: int) -> list[Drawn]:
    """Return the sides, and for each aggregate lines of equal shares and their percent in its colour."""
    alone, sides = np.eye(3), places(np.eye(3)[[0, 1, 2, 0]])
    series = [scatter(x=sides[:, 0], y=sides[:, 1], mode="lines", line={"color": INK, "width": 1.5}, hoverinfo="skip",
                      showlegend=False, name="sides")]  # fmt: skip
    for k in range(count):
        before, after = alone[(k + 1) % 3], alone[(k + 2) % 3]
        lines = [places([share * alone[k] + (1 - share) * end for end in (before, after)]) for share in TICKS]
        path = np.concatenate([np.concatenate([line, [[np.nan, np.nan]]]) for line in lines])
        ends = [line[0] + AWAY * (line[0] - line[1]) / np.linalg.norm(line[0] - line[1]) for line in lines]
        series += [
            scatter(x=path[:, 0], y=path[:, 1], mode="lines", line={"color": THIN, "width": 1, "dash": "dot"},
                    hoverinfo="skip", showlegend=False, name="shares"),
            scatter(
                x=[end[0] for end in ends], y=[end[1] for end in ends], mode="text", textposition=BESIDE[k],
                text=[f"{100.0 * share:g}" for share in TICKS], textfont={"color": LINES[k], "size": 12},
                hoverinfo="skip", showlegend=False, name="percent",
            ),
        ]  # fmt: skip
    return series


def _corners(names: Sequence[str]) -> list[Drawn]:
    """Return the aggregates' names at the corners."""
    return [
        {
            "x": CORNERS[k, 0], "y": CORNERS[k, 1], "showarrow": False, "xanchor": ANCHORS[k],
            "text": f"{'<br>'.join(map(shown, textwrap.wrap(name, WIDTH) or ['']))} [%]",
            "yanchor": "bottom" if k == 0 else "top", "yshift": 6 if k == 0 else -22,
            "font": {"color": LINES[k], "size": 14},
        }
        for k, name in enumerate(names)
    ]  # fmt: skip


def share_profiles(known: Proportions, result: Swept) -> go.Figure:
    """Return, for each aggregate, the PD of the densest mix that has so much of it, over its share; stars: the densest.

    The other shares are those that pack best beside it.
    """
    series = list[Drawn]()
    for k, name in enumerate(known.names):
        own = np.round(result.shares[:, k], 6)
        best = [max(np.flatnonzero(own == share), key=result.packing_density.__getitem__) for share in np.unique(own)]
        color = LINES[k % len(LINES)]
        series += [
            scatter(
                x=100.0 * own[best], y=result.packing_density[best], mode="lines+markers", name=shown(name),
                line={"color": color}, marker={"size": 5},
                error_y={"type": "data", "array": result.deviation[best], "thickness": 1, "width": 0},
                text=[_mix(known.names, row) for row in result.shares[best]],
                hovertemplate="%{text}<br>PD %{y:.4f}<extra></extra>",
            ),
            scatter(
                x=[100.0 * result.densest.shares[k]], y=[result.densest.packing_density], mode="markers",
                showlegend=False, marker={"symbol": "star", "size": 14, "color": color}, hoverinfo="skip",
                name="densest mix",
            ),
        ]  # fmt: skip
    return _over_share(series, "share of the aggregate [% of solid volume]")
