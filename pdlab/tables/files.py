"""CSV files, Excel workbooks and pandas frames → records, with every problem by file, row and column."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from pdlab.errors import Problem, TableError
from pdlab.tables.cells import Typed
from pdlab.tables.layout import LAYOUT, Tables
from pdlab.tables.records import Rows, gather
from pdlab.tables.sheets import Sheet, kind_of, read_sheet
from pdlab.tables.workbooks import WORKBOOK, read_workbook

OTHER_BOOKS = (".xls", ".xlsb", ".ods", ".numbers")


def read_path(path: Path) -> Tables:
    """Read a table, a workbook of tables or a folder of them. Raises TableError when there is none to read.

    What is wrong inside the tables is gathered in ``Tables.problems``.
    """
    out, rows = Tables(), Rows()
    for kind, file in _files(path, out):
        sheets = read_workbook(file, out) if file.suffix.lower() == WORKBOOK else [(kind, _read_csv(file, out))]
        for name, sheet in sheets:
            if sheet is not None:
                read_sheet(sheet, name or kind_of(sheet.header), rows, out)
            else:
                out.unreadable.add(name)
    return gather(rows, out)


def _files(path: Path, out: Tables) -> list[tuple[str, Path]]:
    """Return the tables at a path with their kind, empty where the header must tell it."""
    try:
        if path.is_file() and path.suffix.lower() in OTHER_BOOKS:
            message = f"'{path.suffix}' cannot be read; save it as .xlsx, or its sheets as CSV"
            raise TableError([Problem(path.name, None, None, message)])
        if path.is_file():
            return [("", path)]
        if not path.is_dir():
            raise TableError([Problem(str(path), None, None, "no such file or folder; correct the path")])
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in (".csv", WORKBOOK))
    except OSError as error:
        message = f"it cannot be read ({error.strerror}); correct the path or its permissions"
        raise TableError([Problem(str(path), None, None, message)]) from error
    wanted = ", ".join(f"{name}.csv" for name in LAYOUT)
    if not found:
        raise TableError([Problem(str(path), None, None, f"the folder holds no table; it may hold {wanted}")])
    for file in found:
        if file.suffix.lower() == WORKBOOK:
            message = "a workbook is no table of a folder; import it alone, or move it elsewhere"
            out.problems.append(Problem(file.name, None, None, message))
        elif file.stem not in LAYOUT:
            out.problems.append(Problem(file.name, None, None, f"no table of this name; a folder may hold {wanted}"))
    return [(name, path / f"{name}.csv") for name in LAYOUT if path / f"{name}.csv" in found]


def read_frame(frame: pd.DataFrame, kind: str) -> Tables:
    """Read one table from a pandas frame, as if it had been a file's text."""
    return read_frames({kind: frame})


def read_frames(frames: dict[str, pd.DataFrame]) -> Tables:
    """Read tables from pandas frames by their names, as if they had been files' text."""
    out, rows = Tables(), Rows()
    for kind, frame in frames.items():
        text = frame.astype(object).where(frame.notna(), "").map(_frame_text)
        lines = [(k + 2, list(line)) for k, line in enumerate(text.itertuples(index=False, name=None))]
        header = [str(name).strip() for name in frame.columns]
        read_sheet(Sheet(f"{kind} frame", header, lines), kind, rows, out)
    return gather(rows, out)


def _frame_text(value: Any) -> str:
    return Typed(value) if isinstance(value, float) else str(value)


def _decode(content: bytes) -> str:
    """Return a file's text: UTF-8 with or without BOM, else the Western European code page."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252")


def _read_csv(file: Path, out: Tables) -> Sheet | None:
    """Return a CSV file's cells as text; None, and a problem, where it is no table."""
    try:
        text = _decode(file.read_bytes())
        separator = max(",;\t", key=text.split("\n", 1)[0].count)
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True)
        numbered = list(_numbered(reader))
    except (UnicodeDecodeError, csv.Error) as error:
        out.problems.append(Problem(file.name, None, None, f"this is no table ({error}); save it as CSV in UTF-8"))
        return None
    except OSError as error:
        out.problems.append(Problem(file.name, None, None, f"it cannot be read ({error.strerror}); allow reading it"))
        return None
    if not numbered:
        out.problems.append(Problem(file.name, None, None, "this is no table (it is empty); give it a header row"))
        return None
    return Sheet(file.name, [name.strip() for name in numbered[0][1]], numbered[1:])


def _numbered(reader: Any) -> Iterator[tuple[int, list[str]]]:
    """Give each line that is not blank with the row in which it begins."""
    begins = 1
    for cells in reader:
        if any(cell.strip() for cell in cells):
            yield begins, cells
        begins = reader.line_num + 1
