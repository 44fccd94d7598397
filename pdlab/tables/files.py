"""CSV files and pandas frames → parsed rows, with every problem by file, row and column.

Rows are counted as a spreadsheet counts them: the header is row 1.
"""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pdlab.errors import Problem, TableError
from pdlab.tables.cells import ParseError
from pdlab.tables.layout import LAYOUT, MARKS, Column, Row, Tables
from pdlab.tables.records import Rows, gather


@dataclass(frozen=True)
class Sheet:
    """A table's cells as text: the file's name, its header, and its lines with their row numbers."""

    file: str
    header: list[str]
    lines: list[tuple[int, list[str]]]


def read_path(path: Path) -> Tables:
    """Read a table or a folder of tables. Raises TableError when there is none to read.

    What is wrong inside the tables is gathered in ``Tables.problems``.
    """
    out, rows = Tables(), Rows()
    for kind, file in _files(path, out):
        sheet = _read_csv(file, out)
        if sheet is not None:
            _read_sheet(sheet, kind or _kind_of(sheet.header), rows, out)
        else:
            out.unreadable.add(kind)
    return gather(rows, out)


def _files(path: Path, out: Tables) -> list[tuple[str, Path]]:
    """Return the tables at a path with their kind, empty where the header must tell it."""
    try:
        if path.is_file():
            return [("", path)]
        if not path.is_dir():
            raise TableError([Problem(str(path), None, None, "no such file or folder; correct the path")])
        found = sorted(file for file in path.iterdir() if file.suffix.lower() == ".csv")
    except OSError as error:
        message = f"it cannot be read ({error.strerror}); correct the path or its permissions"
        raise TableError([Problem(str(path), None, None, message)]) from error
    wanted = ", ".join(f"{name}.csv" for name in LAYOUT)
    if not found:
        raise TableError([Problem(str(path), None, None, f"the folder holds no table; it may hold {wanted}")])
    for file in found:
        if file.stem not in LAYOUT:
            out.problems.append(Problem(file.name, None, None, f"no table of this name; a folder may hold {wanted}"))
    return [(name, path / f"{name}.csv") for name in LAYOUT if path / f"{name}.csv" in found]


def read_frame(frame: pd.DataFrame, kind: str) -> Tables:
    """Read one table from a pandas frame, as if it had been a file's text."""
    return read_frames({kind: frame})


def read_frames(frames: dict[str, pd.DataFrame]) -> Tables:
    """Read tables from pandas frames by their names, as if they had been files' text."""
    out, rows = Tables(), Rows()
    for kind, frame in frames.items():
        text = frame.astype(object).where(frame.notna(), "").map(str)
        lines = [(k + 2, list(line)) for k, line in enumerate(text.itertuples(index=False, name=None))]
        header = [str(name).strip() for name in frame.columns]
        _read_sheet(Sheet(f"{kind} frame", header, lines), kind, rows, out)
    return gather(rows, out)


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


def _kind_of(header: list[str]) -> str:
    return next((kind for kind, mark in MARKS.items() if mark in header), "")


def _read_sheet(sheet: Sheet, kind: str, rows: Rows, out: Tables) -> None:
    """Parse every cell of a table; append its rows and problems."""
    wrong = [Problem(sheet.file, 1, name, message) for name, message in _check_header(sheet.header, kind)]
    if kind and not sheet.lines:
        wrong.append(Problem(sheet.file, None, None, "the table is empty; fill it or leave it out"))
    out.problems += wrong
    if any(name not in sheet.header for name, column in LAYOUT.get(kind, {}).items() if column.required) or not kind:
        out.unreadable.add(kind)
        return
    for line, cells in sheet.lines:
        extra = [cell for cell in cells[len(sheet.header) :] if cell.strip()]
        if extra or len(cells) < len(sheet.header):
            message = (
                f"{len(cells)} cells under {len(sheet.header)} columns; put a text with the separator in quotes, and "
                "use semicolons between cells with decimal commas"
            )
            out.problems.append(Problem(sheet.file, line, None, message))
        raw = {name: cell for name, cell in zip(sheet.header, cells, strict=False) if name in LAYOUT[kind]}
        rows.of(kind).append(_parse_row(raw, LAYOUT[kind], (sheet.file, line), out, not extra))


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


def _parse_row(raw: dict[str, str], layout: dict[str, Column], place: tuple[str, int], out: Tables, whole: bool) -> Row:
    cells, sound = dict[str, Any](), whole
    for name, column in layout.items():
        text, cells[name] = raw.get(name, ""), None
        if not text.strip():
            if column.required:
                out.problems.append(Problem(*place, name, "the cell is empty; fill it"))
                sound = False
            continue
        try:
            cells[name] = column.parse(text)
        except ParseError as error:
            out.problems.append(Problem(*place, name, str(error)))
            sound = False
    return Row(*place, cells, raw, sound)
