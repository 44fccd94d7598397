"""Tables as text → a folder of CSV files or one Excel workbook, in the format that is read."""

import csv
import datetime as dt
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pdlab.errors import InputError
from pdlab.tables.cells import NUMBER
from pdlab.tables.layout import LAYOUT
from pdlab.tables.workbooks import WORKBOOK

LONGEST_TEXT = 32_767
"""Characters that Excel keeps in a cell."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What begins a formula in a spreadsheet."""


def check_target(path: Path) -> None:
    """Raise InputError unless tables can be written at ``path``: nothing is overwritten."""
    try:
        if path.is_dir() and path.suffix.lower() != WORKBOOK:
            if any(path.iterdir()):
                raise InputError(f"the folder {path} is not empty and would be overwritten; name another")
        elif path.exists() and (path.is_dir() or path.stat().st_size):
            raise InputError(f"{path} is there and would be overwritten; name another folder or .xlsx file")
        elif path.suffix.lower() in (".csv", ".xls", ".xlsb", ".ods"):
            raise InputError(f"{path} would be a folder of CSV files; name a folder, or a file that ends in .xlsx")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}); name another") from error


def write_tables(tables: dict[str, list[dict[str, str]]], path: Path) -> list[Path]:
    """Write each table's rows, text by column, and return the files; an empty table or column is left out.

    Numbers have a decimal point; in a workbook (``path`` ends in .xlsx) they and the dates are typed.
    Raises InputError where something would be overwritten or cannot be written.
    """
    check_target(path)
    filled = {kind: _lines(kind, rows) for kind, rows in tables.items() if rows}
    if path.suffix.lower() == WORKBOOK:
        contents = {path: _workbook(filled, path)}
    else:
        contents = {path / f"{kind}.csv": _csv(lines) for kind, lines in filled.items()}
    try:
        for file, content in contents.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}); name another") from error
    return list(contents)


def _lines(kind: str, rows: list[dict[str, str]]) -> list[list[str]]:
    """Return a table's header and its lines, with the columns of which a cell is filled."""
    header = [name for name in LAYOUT[kind] if any(row.get(name) for row in rows)]
    return [header, *([row.get(name, "") for name in header] for row in rows)]


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV to be looked at in a spreadsheet: numbers with all their digits and a decimal point.

    A text that a spreadsheet would take for a formula has an apostrophe before it.
    """
    text = io.StringIO(newline="")
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(columns)
    lines.writerows([_harmless(value) for value in row] for row in rows)
    return text.getvalue()


def _harmless(value: object) -> object:
    return f"'{value}" if isinstance(value, str) and value.lstrip(" ").startswith(FORMULA) else value


def _csv(lines: list[list[str]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue().encode("utf-8")


def _workbook(tables: dict[str, list[list[str]]], path: Path) -> bytes:
    from openpyxl import Workbook

    book, out = Workbook(), io.BytesIO()
    book.remove(book.worksheets[0])
    for kind, lines in tables.items():
        sheet = book.create_sheet(kind)
        sheet.freeze_panes = "A2"
        for k, line in enumerate(lines, start=1):
            for j, text in enumerate(line, start=1):
                if len(text) > LONGEST_TEXT:
                    raise InputError(
                        f"{path}, sheet {kind}, row {k}: a text of {len(text)} characters is longer than the "
                        f"{LONGEST_TEXT} of an Excel cell; export to a folder of CSV files"
                    )
                if text:
                    _fill(sheet.cell(k, j), text, kind, lines[0][j - 1] if k > 1 else "")
    book.save(out)
    return out.getvalue()


def _fill(cell: Any, text: str, kind: str, column: str) -> None:
    """Give a cell its value: a date, a number with all its digits, or text, which is never a formula."""
    if column and LAYOUT[kind][column].number and NUMBER.fullmatch(text):
        cell.value, cell.data_type = repr(float(text)).removesuffix(".0"), "n"  # openpyxl would keep 16 digits
    elif column == "date":
        cell.value = dt.date.fromisoformat(text)
    else:
        cell.value, cell.data_type = text, "s"
