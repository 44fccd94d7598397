"""Backups of a live store, and copies from one database to the other, each all or nothing.

A copy is compared afterwards: rows and checksum of each table. The checksum is the SHA-256 over the canonical
texts of its rows in the order of the primary key, so that it is the same on both databases.
"""

import datetime as dt
import hashlib
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from pdlab.errors import StoreError
from pdlab.store.databases import LOCK_TIMEOUT, connected, is_sqlite, parse, reason, refusal, shown, store_url
from pdlab.store.revisions import check_revision, migrate, revision_of, stamped

BATCH = 20
"""Rows in memory at once; one may hold a bed of some MB."""


@dataclass(frozen=True)
class TableCopy:
    """A table that was copied: its name, its number of rows and their checksum (SHA-256, hexadecimal)."""

    name: str
    rows: int
    checksum: str


def backup(given: str | os.PathLike[str] | None, file: Path) -> str:
    """Write a store's state of this moment into a new SQLite file, while others write on; return its revision.

    A backup is a store itself. Raises StoreError for a file that is there already, for one that cannot
    be written, and for a backup that is not sound; nothing is left behind then.
    """
    url = parse(store_url(given))
    revision = _revision_to_read(url)
    check_revision(url, revision, older_is_fine=True)
    write_backup(url, revision, file)
    return revision


def write_backup(url: sa.URL, revision: str, file: Path) -> None:
    """Write the store of this revision into a new SQLite file. Raises StoreError."""
    with _new_file(file):
        if is_sqlite(url):
            _backup_sqlite(url, file)
        else:
            _copy(url, sa.URL.create("sqlite", database=str(file)), revision)


def _revision_to_read(url: sa.URL) -> str:
    revision = revision_of(url)
    if revision is None:
        raise StoreError(f"{shown(url)} holds no store yet; name the one that you mean")
    return revision


@contextmanager
def _new_file(file: Path) -> Iterator[None]:
    """Make a file that was not there; take it away again when the block fails. Raises StoreError."""
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except FileExistsError as error:
        raise StoreError(f"{file} is there already and is not overwritten; choose another name") from error
    except OSError as error:
        raise StoreError(f"{file} cannot be written ({error.strerror}); choose another place") from error
    try:
        yield
    except BaseException:
        for ending in ("", "-wal", "-shm", "-journal"):
            Path(f"{file}{ending}").unlink(missing_ok=True)
        raise


def _backup_sqlite(url: sa.URL, file: Path) -> None:
    """Copy the pages of a SQLite store, all of one moment, and check what came out."""
    try:
        with (
            closing(sqlite3.connect(url.database or "", timeout=LOCK_TIMEOUT)) as source,
            closing(sqlite3.connect(file)) as target,
        ):
            source.backup(target)  # in one step: writers of a WAL file are not held up, nor do they start it anew
            target.execute("PRAGMA journal_mode=DELETE")  # one file, without companions
            faults = [row[0] for row in target.execute("PRAGMA integrity_check") if row[0] != "ok"]
            faults += [f"a row of {row[0]} without its {row[2]}" for row in target.execute("PRAGMA foreign_key_check")]
    except sqlite3.Error as error:
        raise refusal(str(file), error) from error
    if faults:
        raise StoreError(
            f"the backup of {shown(url)} is not sound ({faults[0]}), so the store is not either; put an older backup "
            "in its place"
        )


def copy(source: str | os.PathLike[str], target: str | os.PathLike[str]) -> list[TableCopy]:
    """Copy a store into an empty database, SQLite or PostgreSQL, and compare; return its tables.

    The copy is of one moment; others may write on. Raises StoreError for a source of another revision, for
    a target that holds anything, and for a copy that is not equal; nothing is kept then.
    """
    origin, place = parse(store_url(source)), parse(store_url(target))
    revision = _revision_to_read(origin)
    check_revision(origin, revision)
    revision_of(place)  # refuses what cannot be a store before anything is made
    if not is_sqlite(place) or Path(place.database or "").exists():
        return _copy(origin, place, revision)
    with _new_file(Path(place.database or "")):
        return _copy(origin, place, revision)


def _copy(source: sa.URL, target: sa.URL, revision: str) -> list[TableCopy]:
    with connected(source) as reading, connected(target, writing=True) as writing:
        _make_empty_store(writing, revision, shown(target))
        pairs = _tables(reading, writing)
        out = []
        for origin, place in pairs:
            try:
                sent = _send(reading, origin, writing, place)
            except (sa.exc.DBAPIError, ValueError) as error:
                raise StoreError(
                    f"table {place.name} cannot be copied to {shown(target)} ({reason(error)}); make room there, or "
                    "correct the row in the source"
                ) from error
            if sent != (kept := checksum(writing, place)):
                raise StoreError(
                    f"the copy of table {place.name} differs ({sent.rows} rows, {sent.checksum[:12]}, became "
                    f"{kept.rows} rows, {kept.checksum[:12]}) and was undone; report this"
                )
            out.append(sent)
        if writing.dialect.name == "postgresql":
            _set_sequences(writing, [place for _, place in pairs])
    return out


def _make_empty_store(connection: sa.Connection, revision: str, name: str) -> None:
    """Make the tables of a revision; empty ones of the same revision will do. Raises StoreError."""
    there = stamped(connection, name)
    if there is None:
        migrate(connection, revision)
        return
    full = [table for table in _reflected(connection) if connection.execute(sa.select(table).limit(1)).first()]
    if full or there != revision:
        raise StoreError(
            f"{name} holds a store already and is not overwritten; copy into an empty database or new file"
        )


def _reflected(connection: sa.Connection) -> list[sa.Table]:
    """Return the tables as they stand in the database, parents first; whatever its revision."""
    found = sa.MetaData()
    found.reflect(connection)
    return [table for table in found.sorted_tables if table.name != "alembic_version"]


def _tables(reading: sa.Connection, writing: sa.Connection) -> list[tuple[sa.Table, sa.Table]]:
    """Return the store's tables on both sides, parents first; tables of other programs stay behind."""
    origins = {table.name: table for table in _reflected(reading)}
    return [(origins[place.name], place) for place in _reflected(writing) if place.name in origins]


def _send(reading: sa.Connection, origin: sa.Table, writing: sa.Connection, place: sa.Table) -> TableCopy:
    """Copy the rows of a table in batches; return their number and checksum."""

    def through(batches: Iterator[Sequence[sa.Row[Any]]]) -> Iterator[Sequence[sa.Row[Any]]]:
        for rows in batches:
            writing.execute(place.insert(), [dict(row._mapping) for row in rows])
            yield rows

    return _sum(place.name, through(_batches(reading, origin)))


def checksum(connection: sa.Connection, table: sa.Table) -> TableCopy:
    """Return the number of rows of a table and their checksum."""
    return _sum(table.name, _batches(connection, table))


def _sum(name: str, batches: Iterator[Sequence[sa.Row[Any]]]) -> TableCopy:
    digest, count = hashlib.sha256(), 0
    for rows in batches:
        count += len(rows)
        for row in rows:
            digest.update(f"{'|'.join(_canonical(value) for value in row)}\n".encode())
    return TableCopy(name, count, digest.hexdigest())


def _batches(connection: sa.Connection, table: sa.Table) -> Iterator[Sequence[sa.Row[Any]]]:
    """Yield a table's rows in the order of its key, the columns in the order of their names."""
    columns = sorted(table.columns, key=lambda column: column.name)
    # bytes in their order, whatever the language of the server
    key = [
        column.collate("C")
        if connection.dialect.name == "postgresql" and isinstance(column.type, sa.String)
        else column
        for column in table.primary_key
    ]
    query = sa.select(*columns).order_by(*key).execution_options(yield_per=BATCH)
    with connection.execute(query) as result:
        yield from result.partitions()


def _canonical(value: Any) -> str:
    """Return a text that tells every two values apart and is the same for both databases."""
    if isinstance(value, bytes):
        return f"bytes {hashlib.sha256(value).hexdigest()}"
    if isinstance(value, float):
        return repr(value + 0.0)  # SQLite keeps no negative zero
    return value.isoformat() if isinstance(value, dt.date | dt.datetime) else repr(value)


def _set_sequences(connection: sa.Connection, tables: Sequence[sa.Table]) -> None:
    """Let the next row of each table get the key after the last that was copied."""
    for table in tables:
        for column in table.primary_key:
            name = sa.func.pg_get_serial_sequence(table.name, column.name)
            if connection.scalar(sa.select(name)):
                last = sa.func.max(column)
                connection.execute(sa.select(sa.func.setval(name, sa.func.coalesce(last, 1), last.is_not(None))))
