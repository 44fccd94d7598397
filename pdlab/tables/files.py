"""CSV files, Excel workbooks and pandas frames → records, with every problem by file, row and column."""

import codecs
import csv
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd

from pdlab.errors import Problem, TableError
from pdlab.tables.cells import Typed
from pdlab.tables.layout import LAYOUT, Tables
from pdlab.tables.records import Rows, gather
from pdlab.tables.sheets import Sheet, kind_of, read_sheet
from pdlab.tables.workbooks import WORKBOOK, read_workbook

BLOCK, FRAME_LINES = 1 << 16, 1000
"""Bytes of a file, and lines of a frame, that are taken at once."""
OTHER_BOOKS = (".xls", ".xlsb", ".ods", ".numbers")


def read_path(path: Path) -> Tables:
    """Read a table, a workbook of tables or a folder of them. Raises TableError when there is none to read.

    What is wrong inside the tables is gathered in ``Tables.problems``.
    """
    out, rows = Tables(), Rows()
    for kind, file in files_at(path, out):
        sheets = read_workbook(file, out) if file.suffix.lower() == WORKBOOK else [(kind, _read_csv(file, out))]
        for name, sheet in sheets:
            if sheet is not None:
                read_sheet(sheet, name or kind_of(sheet.header), rows, out)
            else:
                out.unreadable.add(name)
    return gather(rows, out)


def files_at(path: Path, out: Tables) -> list[tuple[str, Path]]:
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
        read_sheet(Sheet(f"{kind} frame", header_of(frame.columns), list(frame_lines(frame))), kind, rows, out)
    return gather(rows, out)


def header_of(names: Iterable[Any]) -> list[str]:
    """Return a table's header as text without blanks around."""
    return [str(name).strip() for name in names]


def frame_lines(frame: pd.DataFrame) -> Iterator[tuple[int, list[str]]]:
    """Give each line of a frame as text with its row number, as if it had been a file's."""
    for begin in range(0, len(frame), FRAME_LINES):
        part = frame.iloc[begin : begin + FRAME_LINES]
        text = part.astype(object).where(part.notna(), "").map(_frame_text)
        for k, line in enumerate(text.itertuples(index=False, name=None), begin + 2):
            yield k, list(line)


def _frame_text(value: Any) -> str:
    return Typed(value) if isinstance(value, float) else str(value)


def encoding_of(file: Path) -> str:
    """Return how a file is to be decoded: UTF-8 with or without BOM, else the Western European code page.

    The file is read through in blocks, so that the table is as large as it likes. Raises OSError.
    """
    decode = codecs.getincrementaldecoder("utf-8-sig")()
    try:
        with file.open("rb") as stream:
            while block := stream.read(BLOCK):
                decode.decode(block)
        decode.decode(b"", final=True)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def csv_lines(file: Path, encoding: str) -> Iterator[tuple[int, list[str]]]:
    """Give each line of a CSV file that is not blank, the header among them, with the row in which it begins.

    The header tells the separator. Raises UnicodeDecodeError, csv.Error and OSError.
    """
    with file.open(encoding=encoding, newline="") as stream:
        separator = max(",;\t", key=stream.readline().count)
        stream.seek(0)
        reader = csv.reader(stream, delimiter=separator, skipinitialspace=True, strict=True)
        begins = 1
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield begins, cells
            begins = reader.line_num + 1


@contextmanager
def csv_problems(file: Path) -> Iterator[None]:
    """Turn what is wrong with a CSV file as a whole into a TableError."""
    try:
        yield
    except (UnicodeDecodeError, csv.Error) as error:
        message = f"this is no table ({error}); save it as CSV in UTF-8"
        raise TableError([Problem(file.name, None, None, message)]) from error
    except OSError as error:
        message = f"it cannot be read ({error.strerror}); allow reading it"
        raise TableError([Problem(file.name, None, None, message)]) from error


def no_table(file: Path) -> Problem:
    """Return the problem of a file without a header."""
    return Problem(file.name, None, None, "this is no table (it is empty); give it a header row")


def _read_csv(file: Path, out: Tables) -> Sheet | None:
    """Return a CSV file's cells as text; None, and a problem, where it is no table."""
    try:
        with csv_problems(file):
            numbered = list(csv_lines(file, encoding_of(file)))
    except TableError as error:
        out.problems += error.problems
        return None
    if not numbered:
        out.problems.append(no_table(file))
        return None
    return Sheet(file.name, header_of(numbered[0][1]), numbered[1:])
