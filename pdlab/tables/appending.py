"""Results into a CSV file, row by row as they come: what stands in it is on the disk within a second.

An earlier output stays as it is until the new one, in a file beside it, holds as many rows or is complete; then the new
one takes its place in one step. A file that is no output is never touched.
"""

import csv
import io
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

from pdlab.errors import InputError, TableError
from pdlab.tables.files import csv_lines, csv_problems

SYNC_EVERY = 1.0
"""Seconds within which a row is on the disk."""
BESIDE = ".part"
"""What the name of a new output ends in while an earlier one stands."""


def earlier_rows(path: Path, columns: Sequence[str]) -> int | None:
    """Return how many rows an earlier output holds, None where there is none, or an empty file.

    A last line that was cut off is no row. Raises InputError for a file that is no output of these columns.
    """
    try:
        if not path.exists() or (path.is_file() and path.stat().st_size == 0):
            return None
        if not path.is_file():
            raise InputError(f"{path} is no file; name another file")
        with csv_problems(path):
            return _rows(path, columns)
    except TableError as error:
        raise InputError(f"{path} is no output of these columns ({error}); name another file") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name another file") from error


def _rows(path: Path, columns: Sequence[str]) -> int:
    """Count the rows of an output. Raises InputError for what is none, csv.Error for what is no table."""
    lines, count, cut = csv_lines(path, "utf-8"), 0, not _ends_line(path)
    _, header = next(lines, (1, []))
    other = 0 if header == list(columns) else 1
    try:
        for row, cells in () if other else lines:
            if len(cells) != len(columns):
                other = 0 if cut and next(lines, None) is None else row
                break
            count += 1
    except csv.Error:
        if not cut:
            raise
    if other:
        raise InputError(f"{path} is no output of these columns (see its row {other}); name another file")
    return count


def _ends_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


class Output:
    """A CSV file of results that grows: ``with Output(path, columns) as out: out.write(rows)``.

    What is wrong with the place is said when it is made, before there are results: raises InputError for a file that
    is there and no earlier output of these ``columns``, and where none can be written. ``rows``: those written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        if path.suffix.lower() != ".csv":
            raise InputError(f"{path} would hold CSV text; name a file that ends in .csv")
        self.path, self.rows, self._columns = path, 0, list(columns)
        self._earlier = earlier_rows(path, columns)
        self._beside = None if self._earlier is None else path.with_name(path.name + BESIDE)
        self._lock, self._synced = threading.Lock(), time.monotonic()
        self._timer: threading.Timer | None = None
        with _named_errors(path):
            self._file = (self._beside or path).open("wb")
            self._append([dict(zip(columns, columns, strict=True))])
            self._sync()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self.close(complete=kind is None)

    def write(self, rows: Sequence[Mapping[str, str]]) -> None:
        """Append rows, text by column, a column that is not given empty. Raises InputError when the disk is full."""
        with _named_errors(self.path), self._lock:
            self._append(rows)
            self.rows += len(rows)
            if self._beside is not None and self.rows >= (self._earlier or 0):
                self._replace()
            wait = self._synced + SYNC_EVERY - time.monotonic()
            if wait <= 0.0:
                self._sync()
            elif self._timer is None:
                self._timer = threading.Timer(wait, self._sync_later)
                self._timer.daemon = True
                self._timer.start()

    def close(self, complete: bool = True) -> None:
        """Bring all to the disk; an earlier output with more rows stays where this one is not ``complete``."""
        with _named_errors(self.path), self._lock:
            if self._file.closed:
                return
            self._sync()
            if self._beside is not None and complete:
                self._replace()
            self._file.close()
            if self._beside is not None:
                self._beside.unlink()

    def _append(self, rows: Sequence[Mapping[str, str]]) -> None:
        text = io.StringIO(newline="")
        csv.DictWriter(text, self._columns, restval="", lineterminator="\n").writerows(rows)
        self._file.write(text.getvalue().encode("utf-8"))
        self._file.flush()

    def _replace(self) -> None:
        """Put the new output in the earlier one's place, in one step and with all its rows on the disk."""
        assert self._beside is not None
        self._sync()
        self._beside.replace(self.path)
        self._beside = None

    def _sync(self) -> None:
        """Bring all that was written to the disk, which no timer need do then."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _sync_later(self) -> None:
        with self._lock:
            if not self._file.closed:
                self._sync()


@contextmanager
def _named_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        message = f"{path} cannot be written ({error.strerror}); make room, allow writing it, or name another file"
        raise InputError(message) from error
