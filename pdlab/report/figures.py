"""Figures for print: SVG with axes, in black and colours that differ in grey and dashes too; names stand outside it.

No text of a user comes into an SVG: what its lines mean is returned beside it.
"""

import io
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pdlab.charts.style import LINES, apart
from pdlab.experiments import DrawnCurve, Explained
from pdlab.grading import Grading
from pdlab.quantities import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 6.9, 3.1
"""Size of a figure on the page [inches]."""
SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "pdlab", "text.parse_math": False, "font.size": 9.0,
    "axes.grid": True, "grid.color": "#d0d0d0", "grid.linewidth": 0.5, "axes.axisbelow": True,
}  # fmt: skip
SILENT = {"Date": None, "Creator": None, "Format": None, "Type": None}
"""Metadata of an SVG: none, so that the same figure is the same bytes."""
DASHES = ((), (6.0, 2.0), (2.0, 2.0), (6.0, 2.0, 1.0, 2.0), (10.0, 3.0))
INK, SHADE = "#000000", "#cfdfe8"
GAP = 0.065
"""Least distance of two labels on the horizontal axis, as a share of its length."""
_alone = threading.Lock()
"""Matplotlib's settings are the process's, and a page draws in several threads."""


@dataclass(frozen=True)
class Line:
    """How a line is drawn: ``dash`` lengths on and off, none for a whole line, and ``width``, all in points."""

    colour: str = INK
    dash: tuple[float, ...] = ()
    width: float = 1.4


@dataclass(frozen=True)
class Figure:
    """An SVG, what is seen in it, and the lines in it by what they mean."""

    svg: str
    seen: str
    lines: tuple[tuple[str, Line], ...] = ()


def grading_curves(gradings: Mapping[str, Grading], mixture: Grading | None = None) -> Figure:
    """Return percent passing over aperture, a line for each name, that of the mixture thick and black."""
    lines = [(name, Line(LINES[k % len(LINES)], DASHES[k % len(DASHES)])) for k, name in enumerate(gradings)]
    drawn = list(zip(gradings.values(), (line for _, line in lines), strict=True))
    if mixture is not None:
        lines.append(("mixture", Line(width=2.6)))
        drawn.append((mixture, lines[-1][1]))

    def draw(axes: "Axes") -> None:
        for grading, line in drawn:
            passing = [100.0 * float(share) for share in grading.passing]
            axes.plot(grading.apertures, passing, color=line.colour, linewidth=line.width, marker="o", markersize=2.5,
                      linestyle=_style(line))  # fmt: skip
        sieves = sorted({aperture for grading, _ in drawn for aperture in grading.apertures})
        axes.set_xscale("log")
        _tick(axes, sieves, math.log10, lambda value: value)
        axes.set(xlabel=label("aperture"), ylabel=label("passing_percent"), ylim=(-2.0, 102.0))
        axes.set_yticks(range(0, 101, 10))

    return Figure(_svg(draw), "Percent passing over aperture on a logarithmic axis", tuple(lines))


def calibration_curve(known: Explained, curve: DrawnCurve) -> Figure:
    """Return what is sought over the coefficient, spaced by its root, with runs, what is measured, and the interval."""
    roots = [math.sqrt(value) for value in curve.values]
    band = [(mean - error, mean + error) for mean, error in zip(curve.means, curve.errors, strict=True)]
    runs = [(math.sqrt(node.value), run) for node in curve.nodes for run in node.runs]
    upright, across = Line("#555555", (1.5, 1.5), 1.2), Line("#8a4b00", (6.0, 2.0), 1.2)

    def draw(axes: "Axes") -> None:
        axes.fill_between(roots, [low for low, _ in band], [high for _, high in band], color=SHADE, linewidth=0.0)
        axes.plot(roots, curve.means, color=INK, linewidth=1.4)
        axes.plot([at for at, _ in runs], [run for _, run in runs], "x", color="#444444", markersize=3.5)
        if known.measured is not None and known.measured_error is not None:
            low, high = known.measured - known.measured_error, known.measured + known.measured_error
            axes.axhspan(low, high, color="#f3dfc4", linewidth=0.0, zorder=0.5)
            axes.axhline(known.measured, color=across.colour, linewidth=across.width, linestyle=_style(across))
        for value in (known.low, known.value, known.high):
            if value is not None:
                axes.axvline(math.sqrt(value), color=upright.colour, linewidth=upright.width, linestyle=_style(upright))
        _tick(axes, [node.value for node in curve.nodes], math.sqrt, math.sqrt)
        axes.set(xlabel=label(curve.coefficient), ylabel=label(curve.sought))

    lines = [("curve, ± its standard error shaded; crosses: single runs", Line())]
    if known.measured is not None:
        lines.append(("measured, ± its standard error shaded", across))
    if known.value is not None:
        lines.append(("the coefficient and the ends of its interval", upright))
    return Figure(_svg(draw), f"{label(curve.sought)} over {label(curve.coefficient)}", tuple(lines))


def parity(own: tuple[float, float, float, float] | None, others: Sequence[tuple[float, float]]) -> Figure:
    """Return predicted over measured packing density; ``own``: measured, its error, predicted, its expected error."""
    points = [*others, *([] if own is None else [(own[0], own[2])])]
    values = [value for point in points for value in point]
    low, high = min(values) - 0.04, max(values) + 0.04

    def draw(axes: "Axes") -> None:
        for band, shade in ((0.02, "#ececec"), (0.01, "#dadada")):
            axes.fill_between([low, high], [low - band, high - band], [low + band, high + band], color=shade,
                              linewidth=0.0)  # fmt: skip
        axes.plot([low, high], [low, high], color=INK, linewidth=0.8)
        axes.plot([at for at, _ in others], [value for _, value in others], "o", color=LINES[0], markersize=4.0)
        if own is not None:
            axes.errorbar([own[0]], [own[2]], xerr=[own[1]], yerr=[own[3]], fmt="D", color=INK, markersize=5.0,
                          linewidth=1.0)  # fmt: skip
        axes.set(xlim=(low, high), ylim=(low, high), xlabel=label("measured"), ylabel=label("predicted"))
        axes.set_aspect("equal")

    return Figure(_svg(draw, 3.6, 3.4), "Predicted over measured packing density")


def _style(line: Line) -> Any:
    """Return a line's dashes as matplotlib takes them, which are in line widths."""
    return (0.0, tuple(length / line.width for length in line.dash)) if line.dash else "-"


def _tick(
    axes: "Axes", values: Sequence[float], along: Callable[[float], float], place: Callable[[float], float]
) -> None:
    """Set the horizontal axis' ticks at rising values, of which those that stand apart ``along`` it have a label.

    ``place``: of a value in the axis' own unit.
    """
    labelled = apart(values, GAP * (along(values[-1]) - along(values[0])), along)
    axes.set_xticks(
        [place(value) for value in values], [f"{value:.4g}" if value in labelled else "" for value in values]
    )
    axes.set_xticks([], minor=True)


def _svg(draw: Callable[["Axes"], None], width: float = WIDTH, height: float = HEIGHT) -> str:
    """Return what is drawn as SVG; the same drawing is the same text."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    out = io.StringIO()
    with _alone, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        canvas = Canvas(figsize=(width, height), layout="constrained")
        draw(canvas.add_subplot())
        canvas.savefig(out, format="svg", metadata=SILENT)
    return out.getvalue()
