"""One Excel workbook, a sheet for each table: its cells → the same text that a CSV file would hold."""

import datetime as dt
import io
import warnings
from pathlib import Path
from typing import Any

from pdlab.errors import Problem
from pdlab.tables.cells import Typed, Unread
from pdlab.tables.layout import LAYOUT, Tables
from pdlab.tables.sheets import Sheet

WORKBOOK = ".xlsx"
MOST_CELLS = 2_000_000
"""Cells of a sheet, empty ones counted, above which one stray cell far out is the likely reason."""


class Dated(str):
    """The text of a date that came as a date."""

    __slots__ = ()


def read_workbook(file: Path, out: Tables) -> list[tuple[str, Sheet | None]]:
    """Return each sheet with the table that it is by its name, empty where its header must tell.

    A sheet that cannot be read is None, and its problem is in ``out``.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        out.problems.append(Problem(file.name, None, None, f"it cannot be read ({error.strerror}); allow reading it"))
        return [("", None)]
    try:
        return _sheets(file, _load(content, cached=True), _load(content, cached=False), out)
    except Exception as error:  # a broken file fails anywhere in openpyxl, zipfile and expat, by errors of any kind
        message = (
            f"this is no Excel workbook that can be read ({type(error).__name__}); save it anew as .xlsx, or as CSV"
        )
        out.problems.append(Problem(file.name, None, None, message))
        return [("", None)]


def _load(content: bytes, *, cached: bool) -> Any:
    """Return a workbook with the values that its formulas had when it was saved, or with the formulas."""
    from openpyxl import load_workbook

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # styles and extensions that openpyxl leaves out hold no value
        return load_workbook(io.BytesIO(content), data_only=cached)


def _sheets(file: Path, values: Any, formulas: Any, out: Tables) -> list[tuple[str, Sheet | None]]:
    filled = [sheet for sheet in values.worksheets if _too_large(sheet) or _filled_lines(_texts(sheet))]
    if not filled:
        out.problems.append(Problem(file.name, None, None, "the workbook is empty; fill a sheet of it"))
    if len(filled) == 1 and filled[0].title not in LAYOUT:
        return [("", _read(file, filled[0], formulas[filled[0].title], out))]
    for sheet in filled:
        if sheet.title not in LAYOUT:
            message = f"no table of this name; a workbook's sheets may be {', '.join(LAYOUT)}"
            out.problems.append(Problem(_name(file, sheet), None, None, message))
    named = {sheet.title: sheet for sheet in filled}
    return [(kind, _read(file, named[kind], formulas[kind], out)) for kind in LAYOUT if kind in named]


def _name(file: Path, sheet: Any) -> str:
    return f"{file.name}, sheet {sheet.title}"


def _too_large(sheet: Any) -> bool:
    return bool(sheet.max_row * sheet.max_column > MOST_CELLS)


def _texts(sheet: Any) -> list[list[str]]:
    return [[_text(cell) for cell in row] for row in sheet.iter_rows()]


def _filled_lines(texts: list[list[str]]) -> list[tuple[int, list[str]]]:
    """Return the lines that are not blank, with their row numbers."""
    return [(k, row) for k, row in enumerate(texts, start=1) if any(text.strip() for text in row)]


def _read(file: Path, values: Any, formulas: Any, out: Tables) -> Sheet | None:
    """Return a sheet's cells as text; None, and a problem, where it is too large to be a table."""
    if _too_large(values):
        message = (
            f"its cells reach to row {values.max_row} and column {values.max_column}, more than {MOST_CELLS} cells; "
            "delete what stands far out"
        )
        out.problems.append(Problem(_name(file, values), None, None, message))
        return None
    texts = _texts(values)
    for k, row in enumerate(formulas.iter_rows()):
        for j, cell in enumerate(row):
            if cell.data_type == "f" and values.cell(k + 1, j + 1).value is None:
                texts[k][j] = Unread(
                    "the formula has no value; open the workbook in Excel and save it, or write the value"
                )
    for area in values.merged_cells.ranges:
        for k, j in area.cells:
            texts[k - 1][j - 1] = Unread(f"the cells {area.coord} are merged; part them and fill each")
    lines = _filled_lines(texts)
    header = [name.strip() for name in lines[0][1]]
    return Sheet(_name(file, values), header, [(k, _dated(header, row)) for k, row in lines[1:]])


def _dated(header: list[str], row: list[str]) -> list[str]:
    """Refuse dates outside of the date column: Excel makes them of 3/8 and 5-26 unasked."""
    return [
        Unread(f"the cell holds the date {text}; format it as text and write it anew")
        if isinstance(text, Dated) and name != "date" else text
        for name, text in zip(header, row, strict=True)
    ]  # fmt: skip


def _text(cell: Any) -> str:
    """Return a cell's text: a number with all its digits, a date as 2026-03-31."""
    value = cell.value
    if value is None or (isinstance(value, str) and cell.data_type != "e"):
        return value or ""
    if cell.data_type == "e":
        return Unread(f"the cell shows the error {value}; mend its formula or write the value")
    if isinstance(value, bool):
        return Unread(f"the cell holds {str(value).upper()}, neither a number nor a text; correct it")
    if isinstance(value, int | float):
        return _number_text(value, cell.number_format)
    if isinstance(value, dt.datetime) and value.time() == dt.time():
        return Dated(value.date().isoformat())
    return Unread(f"the cell holds the time {value}; write a date without a time of day")


def _number_text(value: float, shown_as: str) -> str:
    """Return all the digits of a number, unless Excel shows it as a percentage, a hundred times as large."""
    if "%" in shown_as:
        shown = f"{100 * value:.6g}"
        return Unread(f"the cell holds {value:.6g} and shows {shown} %; format it as a number and write {shown}")
    return Typed(repr(value))
