"""Opening a store, its transactions, and bringing it to the newest revision."""

import datetime as dt
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import sqlalchemy as sa
from sqlalchemy.orm import Session

from pdlab.errors import MigrationFailed
from pdlab.store.copying import write_backup
from pdlab.store.databases import (
    connected,
    engine,
    in_memory,
    is_sqlite,
    named_errors,
    parse,
    reason,
    remedy,
    shown,
    store_url,
)
from pdlab.store.keeping import kept_for_lists
from pdlab.store.revisions import check_revision, head, migrate, revision_of


@dataclass(frozen=True)
class Store:
    """A store that is open: ``read`` and ``write`` give a session in one transaction each.

    ``url`` is its address as it may be shown, without a password.
    """

    url: str
    reader: sa.Engine | sa.Connection = field(repr=False)
    writer: sa.Engine | sa.Connection = field(repr=False)
    created: bool = False

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Give a session that sees one state of the store; nothing written in it is kept. Raises StoreError."""
        with named_errors(self.url), self._session(self.reader) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Give a session whose changes are kept together when the block ends well, else none.

        Writers wait for each other, so that none writes over what it has not read. Raises StoreError.
        """
        with named_errors(self.url), self._session(self.writer) as session, session.begin(), kept_for_lists(session):
            yield session

    @contextmanager
    def snapshot(self) -> Iterator["Store"]:
        """Give a store whose every ``read`` sees the one state of now, whatever is written meanwhile.

        Its ``write`` writes into the store as it is, where the snapshot does not see it. Raises StoreError.
        """
        if isinstance(self.reader, sa.Connection):  # one transaction already
            yield self
            return
        with named_errors(self.url), self.reader.connect() as connection, connection.begin():
            yield Store(self.url, connection, self.writer)

    @contextmanager
    def rehearsal(self) -> Iterator["Store"]:
        """Give a store in which all can be written and read, and of which nothing is kept. Raises StoreError."""
        with named_errors(self.url):
            if isinstance(self.writer, sa.Connection):
                with self.writer.begin_nested() as undone:
                    yield self
                    undone.rollback()
                return
            with self.writer.connect() as connection, connection.begin() as undone:
                yield Store(self.url, connection, connection)
                undone.rollback()

    @staticmethod
    def _session(bind: sa.Engine | sa.Connection) -> Session:
        if isinstance(bind, sa.Connection):  # somebody else's transaction, a test's
            return Session(bind, join_transaction_mode="create_savepoint", expire_on_commit=False)
        return Session(bind, expire_on_commit=False)

    def close(self) -> None:
        """Give the connections back."""
        for bind in (self.reader, self.writer):
            if isinstance(bind, sa.Engine):
                bind.dispose()


def open_store(given: str | os.PathLike[str] | None = None) -> Store:
    """Open a store; a SQLite file that does not exist and an empty database are made by the migrations.

    Raises StoreError for what is no store and for a store of an older or newer revision.
    """
    url = parse(store_url(given))
    if in_memory(url):
        memory = engine(url)
        migrate(memory)
        return Store(shown(url), memory, memory, created=True)
    revision = revision_of(url)
    if revision is None:
        _upgrade(url, None)
    else:
        check_revision(url, revision)
    return Store(shown(url), engine(url), engine(url, writing=True), created=revision is None)


def is_made(given: str | os.PathLike[str] | None = None) -> bool:
    """Return whether there is a store, without making one. Raises StoreError for what is none."""
    url = parse(store_url(given))
    return not in_memory(url) and revision_of(url) is not None


class Upgraded(NamedTuple):
    """The revisions of a store before (None: there was none) and after, and the backup made in between."""

    before: str | None
    after: str
    backup: Path | None


def upgrade(given: str | os.PathLike[str] | None = None) -> Upgraded:
    """Bring a store to the newest revision after a backup, or make it when it is missing.

    All or nothing. Raises StoreError for what is no store, for a newer one and for a backup that cannot be
    written; MigrationFailed.
    """
    url = parse(store_url(given))
    before = revision_of(url)
    if before is not None:
        check_revision(url, before, older_is_fine=True)
    kept = _upgrade(url, before) if before != head() else None
    return Upgraded(before, head(), kept)


def _upgrade(url: sa.URL, before: str | None) -> Path | None:
    """Run the migrations in one transaction; return the backup of what was there."""
    kept = None
    with connected(url, writing=True, foreign_keys=False) as connection:
        if before is not None:  # inside the lock: nobody writes between backup and migration
            kept = _backup_name(url, before)
            write_backup(url, before, kept)
        try:
            migrate(connection)
        except Exception as error:
            if isinstance(error, sa.exc.DBAPIError) and remedy(error):
                raise
            as_before = "the store is as it was" + (f" and as in the backup {kept}" if kept else "")
            raise MigrationFailed(
                f"the migration of {shown(url)} from revision {before or 'none'} to {head()} failed ({reason(error)}) "
                f"and was undone, so {as_before}; report this"
            ) from error
    return kept


def _backup_name(url: sa.URL, revision: str) -> Path:
    """Return a backup's name with revision and time: beside a SQLite file, else in the current folder."""
    place = Path(url.database or "store")
    stamp = f"revision-{revision}.{dt.datetime.now(dt.UTC):%Y%m%dT%H%M%SZ}.db"
    return place.with_name(f"{place.stem}.{stamp}") if is_sqlite(url) else Path(f"{place.name}.{stamp}")
