"""The table format: which tables there are, their columns, and the records that they become."""

import datetime as dt
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pdlab.density import BASES, COMPACTIONS
from pdlab.errors import Problem
from pdlab.grading import SieveTable
from pdlab.tables.cells import (
    above_zero,
    number,
    parse_date,
    parse_integer,
    parse_text,
    percent_below_100,
    word_of,
)
from pdlab.tables.designations import parse_aperture


@dataclass(frozen=True)
class Column:
    """How a column is read, whether every row must fill it, and whether it holds numbers."""

    parse: Callable[[str], Any]
    required: bool = False
    number: bool = False


def _number(parse: Callable[[str], float | None], required: bool = False) -> Column:
    return Column(parse, required, number=True)


BULK = ("kg/m³", "kg/m3")
SIEVE_UNITS = {"retained_g": "g", "retained_percent": "%", "passing_percent": "%"}
DENSITY_UNITS: dict[str, tuple[str, ...]] = {"bulk_density_kg_m3": BULK, "voids_percent": ("%",), "packing_density": ()}
DENSITY_KINDS = tuple(DENSITY_UNITS)
SHARE_KINDS = ("solid_volume_share", "mass_share")
LAYOUT: dict[str, dict[str, Column]] = {
    "aggregates": {
        "name": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        "particle_density_kg_m3": _number(above_zero(*BULK)),
        "density_basis": Column(word_of(*BASES)),
        "water_absorption_percent": _number(percent_below_100),
        "shape": Column(parse_text),
        "source": Column(parse_text),
        "repose_angle_deg": _number(number("°")),
        "wall_angle_deg": _number(number("°")),
    },
    "sieves": {
        "aggregate": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        "analysis": Column(parse_text),
        "aperture_mm": _number(parse_aperture, required=True),
        **{kind: _number(number(unit)) for kind, unit in SIEVE_UNITS.items()},
        "sample_mass_g": _number(above_zero("g")),
        "pan_lower_mm": _number(above_zero("mm")),
        "standard": Column(parse_text),
        "date": Column(parse_date),
    },
    "packing_tests": {
        "material": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        "compaction": Column(word_of(*COMPACTIONS), required=True),
        **{kind: _number(number(*units)) for kind, units in DENSITY_UNITS.items()},
        "repeats": _number(parse_integer),
        "standard_deviation": _number(number(*BULK, "%")),
        "container_diameter_mm": _number(above_zero("mm")),
        "container_height_mm": _number(above_zero("mm")),
        "moisture_percent": _number(percent_below_100),
        "standard": Column(parse_text),
        "date": Column(parse_date),
    },
    "mixtures": {
        "mixture": Column(parse_text, required=True),
        "aggregate": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        **{kind: _number(number()) for kind in SHARE_KINDS},
    },
}
MARKS = {"sieves": "aperture_mm", "packing_tests": "compaction", "mixtures": "mixture", "aggregates": "name"}
"""The column by which a table that comes alone is told."""


@dataclass(frozen=True)
class Row:
    """A line of a table: where it stands and its parsed cells, None where a cell was empty.

    ``sound`` is False when a cell could not be read: what such a row says is not known.
    """

    file: str
    line: int
    cells: dict[str, Any]
    raw: dict[str, str]
    sound: bool

    def problem(self, message: str, column: str | None = None) -> Problem:
        """Return a problem of this row."""
        return Problem(self.file, self.line, column, message)


@dataclass(frozen=True)
class SieveRecord:
    """A sieve analysis: its table, the raw text of each row, and where it stood."""

    aggregate: str
    delivery: str
    table: SieveTable
    raw: tuple[str, ...]
    standard: str | None
    date: dt.date | None
    first: Row


@dataclass(frozen=True)
class MixtureRecord:
    """A mixture: aggregates by name and delivery, and their shares, by solid volume or by mass."""

    name: str
    aggregates: tuple[tuple[str, str], ...]
    shares: tuple[float, ...]
    by_mass: bool
    first: Row


@dataclass
class Tables:
    """All that was brought, and every problem found on the way.

    ``named_aggregates`` and ``named_mixtures`` hold the names of rows that were bad themselves, so that
    what rests on them is not reported as unknown; ``unreadable``: tables whose rows are not known.
    """

    aggregates: list[Row] = field(default_factory=list)
    sieves: list[SieveRecord] = field(default_factory=list)
    packing_tests: list[Row] = field(default_factory=list)
    mixtures: list[MixtureRecord] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    named_aggregates: set[tuple[str, str]] = field(default_factory=set)
    named_mixtures: set[str] = field(default_factory=set)
    unreadable: set[str] = field(default_factory=set)

    def excuses_aggregate(self, name: str, delivery: str) -> bool:
        """Return whether an unknown aggregate was brought, by a row that is reported already."""
        return "aggregates" in self.unreadable or (name, delivery) in self.named_aggregates

    def excuses_mixture(self, name: str) -> bool:
        """Return whether an unknown mixture was brought, by rows that are reported already."""
        return "mixtures" in self.unreadable or name in self.named_mixtures
