"""A table of mixtures of any length, read in slices: so many whole mixtures at once, what is wrong with each beside it.

The table is gone through twice. The first time finds what concerns it as a whole: its encoding, a decimal comma, the
names that come back, for which 8 bytes are kept of each name. The second time gives the mixtures; a slice that was
worked on may be forgotten, so that memory does not grow with the table. Only a workbook is held whole.
"""

import itertools
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path

import numpy as np
import pandas as pd

from pdlab.errors import Problem, TableError
from pdlab.tables.cells import decimal_comma
from pdlab.tables.files import csv_lines, csv_problems, encoding_of, files_at, frame_lines, header_of, no_table
from pdlab.tables.layout import MixtureRecord, Row, Tables
from pdlab.tables.records import gather_mixture
from pdlab.tables.sheets import EMPTY, header_problems, number_columns, parse_line
from pdlab.tables.workbooks import WORKBOOK, read_workbook

KIND = "mixtures"
SIZE = 200
"""Mixtures of a slice."""

Line = tuple[int, list[str]]


@dataclass(frozen=True)
class Brought:
    """What a table says of one mixture: its name and its rows as they stood, and its record or its ``problems``."""

    name: str
    rows: tuple[Row, ...]
    record: MixtureRecord | None
    problems: tuple[Problem, ...]


@dataclass(frozen=True)
class Slice:
    """Whole mixtures that follow each other in a table."""

    mixtures: tuple[Brought, ...]


@dataclass(frozen=True)
class Slices:
    """A table of mixtures as its slices, which may be gone through again and again.

    ``count``: the mixtures of the table, of which each is one however wrong it is.
    """

    file: str
    count: int
    _header: list[str] = field(repr=False)
    _lines: Callable[[], Iterator[Line]] = field(repr=False)
    _size: int = field(repr=False)
    _comma: str | None = field(repr=False)
    _twice: frozenset[int] = field(repr=False)

    def __iter__(self) -> Iterator[Slice]:
        """Give the slices in order. Raises TableError where the file cannot be read any longer."""
        groups, first_row = itertools.groupby(self._lines(), self._name), dict[str, int]()
        while mixtures := tuple(self._brought(*group, first_row) for group in itertools.islice(groups, self._size)):
            yield Slice(mixtures)

    def _name(self, line: Line) -> str:
        return _name_in(line, self._header.index("mixture"))

    def _brought(self, name: str, lines: Iterator[Line], first_row: dict[str, int]) -> Brought:
        """Return a mixture with what is wrong in its rows, among them that an earlier one has its name."""
        out = Tables()
        rows = [parse_line(self.file, self._header, KIND, *line, self._comma, out) for line in lines]
        if name and _digest(name) in self._twice:
            before = first_row.setdefault(name, rows[0].line)
            if before != rows[0].line:
                message = (
                    f"mixture '{name}' stands in row {before} already; put the rows of a mixture together, or give "
                    "this one another name"
                )
                out.problems.append(rows[0].problem(message, "mixture"))
        gather_mixture(rows, out)
        record = None if out.problems else out.mixtures[0]
        return Brought(name, tuple(rows), record, tuple(out.problems))


def slices(path: Path, size: int = SIZE) -> Slices:
    """Return the mixtures of a CSV file, or of a workbook's only sheet, ``size`` of them at once.

    Raises TableError for what is no table of mixtures as a whole.
    """
    if path.is_dir():
        message = "this is a folder; name the table of mixtures in it"
        raise TableError([Problem(str(path), None, None, message)])
    [(_, file)] = files_at(path, Tables())
    if file.suffix.lower() == WORKBOOK:
        return _of_workbook(file, size)
    with csv_problems(file):
        encoding = encoding_of(file)
        header = next(csv_lines(file, encoding), None)
        if header is None:
            raise TableError([no_table(file)])

        def lines() -> Iterator[Line]:
            with csv_problems(file):
                yield from itertools.islice(csv_lines(file, encoding), 1, None)

        return _prepared(file.name, header_of(header[1]), lines, size)


def slices_of_frame(frame: pd.DataFrame, size: int = SIZE) -> Slices:
    """Return the mixtures of a pandas frame, ``size`` of them at once, as if it had been a file's text.

    Raises TableError for what is no table of mixtures as a whole.
    """
    return _prepared("mixtures frame", header_of(frame.columns), lambda: frame_lines(frame), size)


def _of_workbook(file: Path, size: int) -> Slices:
    out = Tables()
    sheets = read_workbook(file, out)
    if out.problems:
        raise TableError(out.problems)
    if len(sheets) > 1:
        message = f"it holds {', '.join(kind for kind, _ in sheets)}; keep the mixtures in a workbook of their own"
        raise TableError([Problem(file.name, None, None, message)])
    [(_, sheet)] = sheets
    assert sheet is not None  # or its problem would have been raised
    return _prepared(sheet.file, sheet.header, lambda: iter(sheet.lines), size)


def _prepared(file: str, header: list[str], lines: Callable[[], Iterator[Line]], size: int) -> Slices:
    """Go through a table for what concerns it as a whole. Raises TableError where it is no table of mixtures."""
    wrong = header_problems(file, header, KIND)
    if wrong:
        raise TableError(wrong)
    comma, digests = None, array("Q")
    columns, place = number_columns(header, KIND), header.index("mixture")
    for name, group in itertools.groupby(lines(), lambda line: _name_in(line, place)):
        digests.append(_digest(name))
        for _, cells in group:
            comma = comma or decimal_comma(cells[k] for k in columns if k < len(cells))
    if not digests:
        raise TableError([Problem(file, None, None, EMPTY)])
    found, times = np.unique(np.frombuffer(digests, np.uint64), return_counts=True)
    return Slices(file, len(digests), header, lines, size, comma, frozenset(map(int, found[times > 1])))


def _name_in(line: Line, place: int) -> str:
    """Return the name of the mixture that a line is of, empty where it has none."""
    return line[1][place].strip() if place < len(line[1]) else ""


def _digest(name: str) -> int:
    """Return 8 bytes of a name; that two names share them costs a look at the names, no more."""
    return int.from_bytes(blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "big")
