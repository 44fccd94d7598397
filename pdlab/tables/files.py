"""CSV files and pandas frames → records, with every problem by file, row (as a spreadsheet counts) and column."""

import datetime as dt
import io
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from pdlab.density import BASES, COMPACTIONS
from pdlab.errors import Problem, TableError
from pdlab.grading import KINDS, SieveRow, SieveTable, check
from pdlab.specimen import SHARE_TOLERANCE
from pdlab.tables.cells import (
    ParseError,
    number_above_zero,
    parse_aperture,
    parse_date,
    parse_integer,
    parse_number,
    parse_text,
    percent_below_100,
    word_of,
)


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
    delivery: str | None
    table: SieveTable
    raw: tuple[str, ...]
    standard: str | None
    date: dt.date | None
    first: Row


@dataclass(frozen=True)
class MixtureRecord:
    """A mixture: aggregates and their shares, by solid volume or by mass."""

    name: str
    aggregates: tuple[str, ...]
    shares: tuple[float, ...]
    by_mass: bool
    first: Row


@dataclass
class Tables:
    """All that was brought, and every problem found on the way."""

    aggregates: list[Row] = field(default_factory=list)
    sieves: list[SieveRecord] = field(default_factory=list)
    packing_tests: list[Row] = field(default_factory=list)
    mixtures: list[MixtureRecord] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    named_aggregates: set[str] = field(default_factory=set)
    named_mixtures: set[str] = field(default_factory=set)


@dataclass(frozen=True)
class Column:
    """How a column is read, and whether every row must fill it."""

    parse: Callable[[str], Any]
    required: bool = False


DENSITY_KINDS = ("bulk_density_kg_m3", "voids_percent", "packing_density")
SHARE_KINDS = ("solid_volume_share", "mass_share")
LAYOUT: dict[str, dict[str, Column]] = {
    "aggregates": {
        "name": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        "particle_density_kg_m3": Column(number_above_zero),
        "density_basis": Column(word_of(*BASES)),
        "water_absorption_percent": Column(percent_below_100),
        "shape": Column(parse_text),
        "source": Column(parse_text),
        "repose_angle_deg": Column(parse_number),
        "wall_angle_deg": Column(parse_number),
    },
    "sieves": {
        "aggregate": Column(parse_text, required=True),
        "delivery": Column(parse_text),
        "aperture_mm": Column(parse_aperture, required=True),
        **{kind: Column(parse_number) for kind in KINDS},
        "sample_mass_g": Column(number_above_zero),
        "pan_lower_mm": Column(number_above_zero),
        "standard": Column(parse_text),
        "date": Column(parse_date),
    },
    "packing_tests": {
        "material": Column(parse_text, required=True),
        "compaction": Column(word_of(*COMPACTIONS), required=True),
        **{kind: Column(parse_number) for kind in DENSITY_KINDS},
        "repeats": Column(parse_integer),
        "standard_deviation": Column(parse_number),
        "container_diameter_mm": Column(number_above_zero),
        "container_height_mm": Column(number_above_zero),
        "standard": Column(parse_text),
        "date": Column(parse_date),
    },
    "mixtures": {
        "mixture": Column(parse_text, required=True),
        "aggregate": Column(parse_text, required=True),
        **{kind: Column(parse_number) for kind in SHARE_KINDS},
    },
}
"""The table format: each table's columns."""
MARKS = {"sieves": "aperture_mm", "packing_tests": "compaction", "mixtures": "mixture", "aggregates": "name"}
"""The column by which a single file is told."""


def read_path(path: Path) -> Tables:
    """Read a table or a folder of tables. Raises TableError when there is none to read.

    What is wrong inside the tables is gathered in ``Tables.problems``.
    """
    if path.is_dir():
        files = {name: path / f"{name}.csv" for name in LAYOUT}
        present = {name: file for name, file in files.items() if file.is_file()}
        if not present:
            wanted = ", ".join(f"{name}.csv" for name in LAYOUT)
            raise TableError([Problem(str(path), None, None, f"the folder holds no table; it may hold {wanted}")])
    elif path.is_file():
        present = {"": path}
    else:
        raise TableError([Problem(str(path), None, None, "no such file or folder; correct the path")])
    out, rows = Tables(), dict[str, list[Row]]()
    for name, file in present.items():
        frame = _read_text(file, out.problems)
        if frame is not None:
            _read_frame(frame, name or _kind_of(frame), file.name, rows, out)
    return _gather(rows, out)


def read_frame(frame: pd.DataFrame, kind: str) -> Tables:
    """Read one table from a pandas frame, as if it had been a file's text."""
    return read_frames({kind: frame})


def read_frames(frames: dict[str, pd.DataFrame]) -> Tables:
    """Read tables from pandas frames by their names, as if they had been files' text."""
    out, rows = Tables(), dict[str, list[Row]]()
    for kind, frame in frames.items():
        text = frame.astype(object).where(frame.notna(), "").map(str)
        _read_frame(text, kind, f"{kind} frame", rows, out)
    return _gather(rows, out)


def _read_text(file: Path, problems: list[Problem]) -> pd.DataFrame | None:
    """Return a CSV file's cells as text; None, and a problem, where it is no table."""
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = file.read_bytes().decode("latin-1")
    head = text.split("\n", 1)[0]
    separator = max(",;\t", key=head.count)
    try:
        return pd.read_csv(
            io.StringIO(text), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=True,
            skip_blank_lines=False, index_col=False, on_bad_lines="error",
        )  # fmt: skip
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        message = f"this is no table ({str(error).strip()}); save it as CSV with one header row"
        problems.append(Problem(file.name, None, None, message))
        return None


def _kind_of(frame: pd.DataFrame) -> str:
    names = {str(name).strip() for name in frame.columns}
    return next((kind for kind, mark in MARKS.items() if mark in names), "")


def _read_frame(frame: pd.DataFrame, kind: str, file: str, rows: dict[str, list[Row]], out: Tables) -> None:
    """Parse every cell of a table; append its rows and problems."""
    names = [str(name).strip() for name in frame.columns]
    if not kind:
        marks = ", ".join(f"{mark} ({name})" for name, mark in MARKS.items())
        out.problems.append(Problem(file, 1, None, f"no known table; its header needs one of {marks}"))
        return
    layout = LAYOUT[kind]
    for name in sorted(set(names) - set(layout)):
        known = ", ".join(layout)
        out.problems.append(Problem(file, 1, name, f"'{name}' is no column of {kind}.csv; it knows {known}"))
    for name in [name for name, column in layout.items() if column.required and name not in names]:
        out.problems.append(Problem(file, 1, name, f"the column '{name}' is missing; add it"))
        return
    for number, values in enumerate(frame.itertuples(index=False, name=None)):
        raw = {name: str(value) for name, value in zip(names, values, strict=True) if name in layout}
        if any(value.strip() for value in raw.values()):
            rows.setdefault(kind, []).append(_parse_row(raw, layout, file, number + 2, out))
    _name_all(kind, frame.set_axis(names, axis=1), out)


def _name_all(kind: str, frame: pd.DataFrame, out: Tables) -> None:
    """Remember every name that the tables introduce, so that a bad row is not reported as unknown too."""
    if kind == "aggregates":
        out.named_aggregates |= {str(name).strip() for name in frame["name"]}
    if kind == "mixtures":
        out.named_mixtures |= {str(name).strip() for name in frame["mixture"]}


def _parse_row(raw: dict[str, str], layout: dict[str, Column], file: str, line: int, out: Tables) -> Row:
    cells, sound = dict[str, Any](), True
    for name, column in layout.items():
        text, cells[name] = raw.get(name, ""), None
        if not text.strip():
            if column.required:
                out.problems.append(Problem(file, line, name, "the cell is empty; fill it"))
                sound = False
            continue
        try:
            cells[name] = column.parse(text)
        except ParseError as error:
            out.problems.append(Problem(file, line, name, str(error)))
            sound = False
    return Row(file, line, cells, raw, sound)


def _gather(rows: dict[str, list[Row]], out: Tables) -> Tables:
    """Make records of rows that belong together and check what one table alone can show."""
    out.aggregates = [row for row in rows.get("aggregates", []) if row.sound]
    for row in out.aggregates:
        if (row.cells["particle_density_kg_m3"] is None) != (row.cells["density_basis"] is None):
            message = "a particle density and its basis go together; fill both or neither"
            out.problems.append(row.problem(message, "density_basis"))
    for test in rows.get("packing_tests", []):
        if test.sound and _one_kind(test, DENSITY_KINDS, out.problems) is not None:
            out.packing_tests.append(test)
    for group in _groups(rows.get("sieves", []), "aggregate", "delivery", "standard", "date"):
        _gather_sieves(group, out)
    for group in _groups(rows.get("mixtures", []), "mixture"):
        _gather_mixture(group, out)
    return out


def _groups(rows: Iterable[Row], *keys: str) -> list[list[Row]]:
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.cells[key] for key in keys), []).append(row)
    return list(groups.values())


def _one_kind(row: Row, kinds: tuple[str, ...], problems: list[Problem]) -> str | None:
    given = [kind for kind in kinds if row.cells[kind] is not None]
    if len(given) == 1:
        return given[0]
    what = f"{' and '.join(given)} are" if given else "none is"
    problems.append(row.problem(f"{what} filled; fill exactly one of {', '.join(kinds)}"))
    return None


def _kind_of_group(group: list[Row], kinds: tuple[str, ...], problems: list[Problem]) -> str | None:
    """Return the one kind of value that all rows of a group give; None, and problems, if there is none."""
    if not all(row.sound for row in group):
        return None
    given = [_one_kind(row, kinds, problems) for row in group]
    if None in given:
        return None
    for row, kind in zip(group, given, strict=True):
        if kind != given[0]:
            message = f"this row gives {kind}, those before it {given[0]}; use one for rows that belong together"
            problems.append(row.problem(message, kind))
            return None
    return given[0]


def _gather_sieves(group: list[Row], out: Tables) -> None:
    kind = _kind_of_group(group, KINDS, out.problems)
    if kind is None:
        return
    cells = group[0].cells
    table = SieveTable(
        tuple(SieveRow(row.cells["aperture_mm"], row.cells[kind]) for row in group),
        kind,
        cells["sample_mass_g"],
        cells["pan_lower_mm"],
    )
    wrong = check(table)
    for error in wrong:
        row = group[error.row or 0]
        out.problems.append(row.problem(str(error), None if error.row is None else "aperture_mm"))
    if not wrong:
        raw = tuple(f"{row.raw['aperture_mm']}\t{row.raw[kind]}" for row in group)
        out.sieves.append(
            SieveRecord(cells["aggregate"], cells["delivery"], table, raw, cells["standard"], cells["date"], group[0])
        )


def _gather_mixture(group: list[Row], out: Tables) -> None:
    kind = _kind_of_group(group, SHARE_KINDS, out.problems)
    if kind is None:
        return
    first, name = group[0], group[0].cells["mixture"]
    names = [row.cells["aggregate"] for row in group]
    shares = [row.cells[kind] for row in group]
    for row, share in zip(group, shares, strict=True):
        if not 0.0 < share <= 1.0:
            message = f"share {share:g} lies outside (0, 1]; correct it or leave the row out"
            out.problems.append(row.problem(message, kind))
        if names.count(row.cells["aggregate"]) > 1:
            message = f"'{row.cells['aggregate']}' stands more than once in mixture '{name}'; keep one row"
            out.problems.append(row.problem(message, "aggregate"))
    if abs(math.fsum(shares) - 1.0) > SHARE_TOLERANCE:
        message = (
            f"the shares of mixture '{name}' sum to {math.fsum(shares):.4g}, more than {SHARE_TOLERANCE:g} off 1; "
            "correct them"
        )
        out.problems.append(first.problem(message, kind))
    out.mixtures.append(MixtureRecord(name, tuple(names), tuple(shares), kind == "mass_share", first))
