"""Report data → HTML: templates that escape every text, and how numbers, times and digests are written."""

import base64
import datetime as dt
import itertools
from collections.abc import Iterable
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from pdlab.experiments import ShownCalibration, ShownRun
from pdlab.quantities import heading, label
from pdlab.report import methods
from pdlab.report.figures import Figure

UNKNOWN = "–"
SHORT = 30
"""Lines of a table that stays on one page."""
LONGEST = 70
"""Characters of a title that the head of a printed page holds."""


def page(template: str, **facts: Any) -> str:
    """Return a template filled with facts."""
    return _environment().get_template(template).render(**facts)


def number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    """Return a number with so many decimals, a dash for none."""
    return UNKNOWN if value is None else f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def general(value: float | None, digits: int = 6) -> str:
    """Return a number with so many significant digits, a dash for none."""
    return UNKNOWN if value is None else f"{value:.{digits}g}"


def when(moment: dt.datetime | None) -> str:
    """Return a stored point in time in UTC, a dash for none."""
    return UNKNOWN if moment is None else f"{moment.astimezone(dt.UTC):%Y-%m-%d %H:%M} UTC"


def moment(at: dt.datetime) -> str:
    """Return a point in time with its zone and the zone's distance from UTC."""
    offset = f"{at:%z}"
    return f"{at:%Y-%m-%d %H:%M:%S} (UTC{offset[:3]}:{offset[3:5]})"


def css_text(text: str) -> str:
    """Return text for a string of a style sheet, all but letters, digits and blanks as their numbers."""
    short = text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
    return "".join(one if one == " " or (one.isascii() and one.isalnum()) else f"\\{ord(one):x} " for one in short)


def interval(ends: tuple[float | None, float | None, float | None]) -> str:
    """Return the interval of a coefficient, which comes first, open where an end is None."""
    first, last = ("open" if end is None else f"{end:.4g}" for end in ends[1:])
    return f"{first} to {last}"


def spheres(run: ShownRun) -> str:
    """Return the spheres of a run, species by species."""
    rolling = any(kind[3] for kind in run.spheres)
    return " + ".join(
        f"{count} of d {diameter:g}, μ {friction:g}" + (f", μr {resistance:g}" if rolling else "")
        for count, diameter, friction, resistance in run.spheres
    )


def alike(runs: Iterable[ShownRun]) -> list[tuple[str, list[ShownRun]]]:
    """Return runs in order, those of equal spheres together."""
    return [(text, list(group)) for text, group in itertools.groupby(runs, key=spheres)]


def same_runs(fit: ShownCalibration, fits: Iterable[ShownCalibration]) -> int | None:
    """Return the first of the calibrations where it has the runs of a later one, None where it is that one itself."""
    first = next(one for one in fits if one.runs == fit.runs)
    return None if first.key == fit.key or not fit.runs else first.key


def engines(runs: Iterable[ShownRun]) -> list[tuple[str, int]]:
    """Return by which engine version, numba and processor runs were made, and how many by each."""
    made = [
        f"engine version {run.engine_version}, numba {run.numba_version or 'unknown'}, "
        f"processor {run.processor or 'unknown'}"
        for run in runs
    ]
    return [(text, made.count(text)) for text in sorted(set(made))]


def picture(figure: Figure) -> str:
    """Return a figure as an address that holds it."""
    return f"data:image/svg+xml;base64,{base64.b64encode(figure.svg.encode()).decode()}"


@cache
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("pdlab.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {
        one.__name__: one
        for one in (
            number,
            general,
            when,
            moment,
            css_text,
            interval,
            alike,
            same_runs,
            engines,
            picture,
            heading,
            label,
        )
    }
    made.globals |= {"methods": methods, "SHORT": SHORT}
    return made
