"""A table's cells as text → parsed rows, with every problem by file, row and column.

Rows are counted as a spreadsheet counts them: the header is row 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from pdlab.errors import Problem
from pdlab.tables.cells import ParseError, Unread, decimal_comma, refuse_dotted
from pdlab.tables.layout import LAYOUT, MARKS, Column, Row, Tables
from pdlab.tables.records import Rows

EMPTY = "the table is empty; fill it or leave it out"


@dataclass(frozen=True)
class Sheet:
    """A table's cells as text: the name of its file or sheet, its header, its lines with their row numbers."""

    file: str
    header: list[str]
    lines: list[tuple[int, list[str]]]


def kind_of(header: list[str]) -> str:
    """Return which table a header is of, empty where it is none."""
    return next((kind for kind, mark in MARKS.items() if mark in header), "")


def read_sheet(sheet: Sheet, kind: str, rows: Rows, out: Tables) -> None:
    """Parse every cell of a table; append its rows and problems."""
    out.problems += header_problems(sheet.file, sheet.header, kind)
    if kind and not sheet.lines:
        out.problems.append(Problem(sheet.file, None, None, EMPTY))
    if any(name not in sheet.header for name, column in LAYOUT.get(kind, {}).items() if column.required) or not kind:
        out.unreadable.add(kind)
        return
    columns = number_columns(sheet.header, kind)
    comma = decimal_comma(cells[k] for _, cells in sheet.lines for k in columns if k < len(cells))
    for line, cells in sheet.lines:
        rows.of(kind).append(parse_line(sheet.file, sheet.header, kind, line, cells, comma, out))


def header_problems(file: str, header: list[str], kind: str) -> list[Problem]:
    """Return what is wrong with the header of a table of this ``kind``, empty for one that it could not tell."""
    return [Problem(file, 1, name, message) for name, message in _check_header(header, kind)]


def number_columns(header: list[str], kind: str) -> list[int]:
    """Return where the columns stand that hold numbers."""
    return [k for k, name in enumerate(header) if name in LAYOUT[kind] and LAYOUT[kind][name].number]


def parse_line(
    file: str, header: list[str], kind: str, line: int, cells: list[str], comma: str | None, out: Tables
) -> Row:
    """Return a line of a table as a row, not sound where a cell cannot be read; its problems go to ``out``.

    ``comma``: a number of the table that has a decimal comma, None where none has.
    """
    extra = [cell for cell in cells[len(header) :] if cell.strip()]
    if extra or len(cells) < len(header):
        message = (
            f"{len(cells)} cells under {len(header)} columns; put a text with the separator in quotes, and "
            "use semicolons between cells with decimal commas"
        )
        out.problems.append(Problem(file, line, None, message))
    for name, cell in zip(header, cells, strict=False):
        if cell.strip() and not name:
            message = f"'{cell.strip()}' stands under no heading; head its column or delete it"
            out.problems.append(Problem(file, line, None, message))
    raw = {name: cell for name, cell in zip(header, cells, strict=False) if name in LAYOUT[kind]}
    return _parse_row(LAYOUT[kind], Row(file, line, {}, raw, not extra), comma, out)


def _check_header(header: list[str], kind: str) -> Iterator[tuple[str | None, str]]:
    if not kind:
        yield None, f"no known table; its header needs one of {', '.join(f'{m} ({name})' for name, m in MARKS.items())}"
        return
    known = ", ".join(LAYOUT[kind])
    for name in dict.fromkeys(header):
        if name and name not in LAYOUT[kind]:
            yield name, f"'{name}' is no column of {kind}.csv; it knows {known}"
        elif name and header.count(name) > 1:
            yield name, f"the column '{name}' stands {header.count(name)} times; keep one"
    for name, column in LAYOUT[kind].items():
        if column.required and name not in header:
            yield name, f"the column '{name}' is missing; add it"


def _parse_row(layout: dict[str, Column], row: Row, comma: str | None, out: Tables) -> Row:
    """Return the row with its cells parsed, not sound where one cannot be read."""
    cells, sound = dict[str, Any](), row.sound
    for name, column in layout.items():
        text, cells[name] = row.raw.get(name, ""), None
        if not text.strip():
            if column.required:
                out.problems.append(row.problem("the cell is empty; fill it", name))
                sound = False
            continue
        try:
            if isinstance(text, Unread):
                raise ParseError(str(text))
            if column.number:
                refuse_dotted(text, comma)
            cells[name] = column.parse(text)
        except ParseError as error:
            out.problems.append(row.problem(str(error), name))
            sound = False
    return replace(row, cells=cells, sound=sound)
