"""A file of one sieve analysis, CSV or Excel → its cells as text, as if they had been typed."""

import csv
import tempfile
from dataclasses import dataclass
from pathlib import Path

from pdlab.errors import Problem, TableError
from pdlab.grading import KINDS
from pdlab.tables.cells import ParseError
from pdlab.tables.designations import parse_aperture
from pdlab.tables.files import OTHER_BOOKS, csv_problems, encoding_of, header_of, no_table
from pdlab.tables.layout import Tables
from pdlab.tables.sheets import Sheet
from pdlab.tables.workbooks import WORKBOOK, read_workbook


@dataclass(frozen=True)
class SieveSheet:
    """The cells of a sieve table, aperture and value, and the ``kind`` of its values where a header names it."""

    cells: tuple[tuple[str, str], ...]
    kind: str | None = None


def read_sieve_file(name: str, content: bytes) -> SieveSheet:
    """Return the sieve table of a file's ``content``: of sieves.csv's columns, or its first two. Raises TableError."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / Path(name).name
        file.write_bytes(content)
        sheet = _sheet(file)
    kinds = [kind for kind in KINDS if kind in sheet.header]
    if "aperture_mm" in sheet.header and len(kinds) == 1:
        return _named(sheet, kinds[0])
    lines = sheet.lines if not _is_sieve(sheet.header) else [(1, sheet.header), *sheet.lines]
    short = next((line for line, cells in lines if len(cells) < 2), None)
    if short is not None or not lines:
        message = "a sieve table has two columns, aperture and value; write both, or the header of sieves.csv"
        raise TableError([Problem(name, short, None, message)])
    return SieveSheet(tuple((cells[0], cells[1]) for _, cells in lines))


def _sheet(file: Path) -> Sheet:
    """Return a file's cells as text. Raises TableError."""
    if file.suffix.lower() in OTHER_BOOKS:
        message = f"'{file.suffix}' cannot be read; save it as .xlsx, or its sheet as CSV"
        raise TableError([Problem(file.name, None, None, message)])
    if file.suffix.lower() == WORKBOOK:
        out = Tables()
        sheets = [sheet for _, sheet in read_workbook(file, out) if sheet is not None]
        if len(sheets) != 1:
            one = Problem(file.name, None, None, "it must hold one sheet with a sieve table; delete the others")
            raise TableError(out.problems or [one])
        return sheets[0]
    with csv_problems(file):
        text = file.read_text(encoding=encoding_of(file))
        separator = next((mark for mark in ";\t" if mark in text), ",")  # a comma may be a decimal comma
        lines = list(csv.reader(text.splitlines(), delimiter=separator, skipinitialspace=True, strict=True))
    filled = [(k, cells) for k, cells in enumerate(lines, start=1) if any(cell.strip() for cell in cells)]
    if not filled:
        raise TableError([no_table(file)])
    return Sheet(file.name, header_of(filled[0][1]), filled[1:])


def _named(sheet: Sheet, kind: str) -> SieveSheet:
    """Return the columns that a header names, of one aggregate. Raises TableError."""
    places = [sheet.header.index(column) for column in ("aperture_mm", kind)]
    filled = [[*cells, *[""] * (len(sheet.header) - len(cells))] for _, cells in sheet.lines]
    names = (
        {cells[sheet.header.index("aggregate")].strip() for cells in filled} if "aggregate" in sheet.header else set()
    )
    if len(names) > 1:
        message = f"it holds {len(names)} aggregates, and one is entered here; bring all of them by 'pdlab import'"
        raise TableError([Problem(sheet.file, None, "aggregate", message)])
    return SieveSheet(tuple((cells[places[0]], cells[places[1]]) for cells in filled), kind)


def _is_sieve(cells: list[str]) -> bool:
    try:
        parse_aperture(cells[0])
    except ParseError:
        return False
    return True
