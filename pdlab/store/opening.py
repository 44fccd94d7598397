"""Databases, revisions and transactions.

Two engines stand on one SQLite file: the writer's transactions take the lock when they begin, so that
writers queue up instead of failing; the reader's do not.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy.orm import Session
from sqlalchemy.pool import StaticPool

from pdlab.errors import StoreError

DEFAULT_URL = "sqlite:///pdlab.db"
LOCK_TIMEOUT = 30.0
"""Seconds that a writer waits for another."""


def store_url(given: str | os.PathLike[str] | None) -> str:
    """Return the store's URL: the one given, else PDLAB_STORE, else pdlab.db in this folder.

    A path without a scheme is a SQLite file.
    """
    url = (os.fspath(given) if given else None) or os.environ.get("PDLAB_STORE") or DEFAULT_URL
    return url if ":" in url.replace(":\\", "") else f"sqlite:///{url}"


def _migrations() -> Config:
    """Return Alembic's configuration: the migrations lie in the package, in a checkout beside it."""
    package = Path(__file__).parent.parent
    folder = next(place / "migrations" for place in (package, package.parent) if (place / "migrations").is_dir())
    config = Config()
    config.set_main_option("script_location", str(folder).replace("%", "%%"))
    return config


@dataclass(frozen=True)
class Store:
    """A store that is open: ``read`` and ``write`` give a session in one transaction each."""

    url: str
    reader: sa.Engine | sa.Connection
    writer: sa.Engine | sa.Connection
    created: bool = False

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Give a session that sees one state of the store; nothing written in it is kept."""
        with self._named_errors(), self._session(self.reader) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Give a session whose changes are kept together when the block ends well, else none."""
        with self._named_errors(), self._session(self.writer) as session, session.begin():
            yield session

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Turn what the database cannot do now (locked, read-only, disk full) into a StoreError."""
        try:
            yield
        except sa.exc.OperationalError as error:
            raise StoreError(
                f"the store {self.url} cannot be used ({error.orig}); end what else writes to it, allow writing, or "
                "make room on the disk"
            ) from error

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


def _sqlite_engine(url: sa.URL, begin: str, foreign_keys: bool = True) -> sa.Engine:
    memory = url.database in (None, "", ":memory:")
    pool: dict[str, Any] = {"poolclass": StaticPool} if memory else {}
    engine = sa.create_engine(url, connect_args={"timeout": LOCK_TIMEOUT}, **pool)

    @sa.event.listens_for(engine, "connect")
    def prepare(connection: Any, _: Any) -> None:
        connection.isolation_level = None  # transactions begin below, not when the driver thinks so
        if begin == "BEGIN IMMEDIATE" and not memory:
            connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute(f"PRAGMA foreign_keys={'ON' if foreign_keys else 'OFF'}")

    @sa.event.listens_for(engine, "begin")
    def start(connection: sa.Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine


def _engine(url: sa.URL, begin: str = "BEGIN", foreign_keys: bool = True) -> sa.Engine:
    if url.get_backend_name() == "sqlite":
        return _sqlite_engine(url, begin, foreign_keys)
    return sa.create_engine(url)


def _parse(url: str) -> sa.URL:
    try:
        parsed = sa.make_url(url)
        backend = parsed.get_backend_name()
        parsed.get_dialect()
    except (sa.exc.ArgumentError, ValueError) as error:
        raise StoreError(f"'{url}' is no store address; write sqlite:///FILE or a path") from error
    if backend != "sqlite" or parsed.get_driver_name() != "pysqlite":
        raise StoreError(f"'{backend}' stores cannot be opened by this version; write sqlite:///FILE or a path")
    return parsed


def open_store(given: str | os.PathLike[str] | None = None) -> Store:
    """Open a store; a SQLite file that does not exist is made by the migrations.

    Raises StoreError for a file that is no store and for a store of an older or newer revision.
    """
    url = _parse(store_url(given))
    if url.get_backend_name() == "sqlite" and url.database in (None, "", ":memory:"):
        engine = _engine(url)
        migrate(engine)
        return Store(str(url), engine, engine, created=True)
    created = _revision(url) is None
    if created:
        upgrade(url.render_as_string(hide_password=False))
    else:
        _check_revision(url)
    name = url.render_as_string(hide_password=False)
    return Store(name, _engine(url), _engine(url, "BEGIN IMMEDIATE"), created)


def is_made(given: str | os.PathLike[str] | None = None) -> bool:
    """Return whether there is a store, without making one. Raises StoreError for what is none."""
    url = _parse(store_url(given))
    return url.database not in (None, "", ":memory:") and _revision(url) is not None


def upgrade(given: str | os.PathLike[str] | None = None) -> tuple[str | None, str]:
    """Bring a store to the newest revision, making it when it is missing; return before and after.

    All or nothing. Raises StoreError for a file that is no store and for a newer one.
    """
    url = _parse(store_url(given))
    before = _revision(url)
    if before is not None:
        _check_revision(url, older_is_fine=True)
    if before != _head():
        engine = _engine(url, "BEGIN IMMEDIATE", foreign_keys=False)
        try:
            migrate(engine)
        except sa.exc.OperationalError as error:
            raise StoreError(
                f"{url.database} cannot be written ({error.orig}); allow writing there or choose another --store"
            ) from error
        finally:
            engine.dispose()
    return before, _head()


def migrate(bind: sa.Engine | sa.Connection) -> None:
    """Run the migrations on an engine, in one transaction, or on a connection within its own."""
    config = _migrations()
    if isinstance(bind, sa.Connection):
        config.attributes["connection"] = bind
        command.upgrade(config, "head")
        return
    with bind.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _head() -> str:
    head = ScriptDirectory.from_config(_migrations()).get_current_head()
    assert head is not None, "the package lost its migrations"
    return head


def _known_revisions() -> set[str]:
    return {script.revision for script in ScriptDirectory.from_config(_migrations()).walk_revisions()}


def _revision(url: sa.URL) -> str | None:
    """Return the revision of a store, None where there is none yet. Raises StoreError."""
    path = Path(url.database or "")
    try:
        if not path.exists():
            if not path.parent.is_dir():
                raise StoreError(f"the folder of {path} does not exist; make it or choose another --store")
            return None
        if path.is_dir():
            raise StoreError(f"{path} is a folder, no pdlab store; choose a file with --store")
    except OSError as error:
        raise StoreError(f"{path} cannot be opened ({error.strerror}); choose another --store") from error
    engine = _engine(url)
    try:
        with engine.connect() as connection:
            names = set(sa.inspect(connection).get_table_names())
            rows = (
                connection.exec_driver_sql("SELECT version_num FROM alembic_version").all()
                if "alembic_version" in names
                else []
            )
    except sa.exc.OperationalError as error:
        raise StoreError(
            f"{path} cannot be opened ({error.orig}); end what else uses it, or allow reading and writing it"
        ) from error
    except sa.exc.DatabaseError as error:
        raise StoreError(f"{path} is no pdlab store ({error.orig}); choose another file with --store") from error
    finally:
        engine.dispose()
    if not names:
        return None
    if len(rows) == 1 and names >= {"aggregate", "mixture", "run"}:
        return str(rows[0][0])
    raise StoreError(
        f"{path} holds other tables ({', '.join(sorted(names)[:3])}), no pdlab store; choose another file with --store"
    )


def _check_revision(url: sa.URL, older_is_fine: bool = False) -> None:
    revision, head = _revision(url), _head()
    if revision not in _known_revisions():
        raise StoreError(
            f"{url.database} is a store of revision {revision}, newer than the {head} of this pdlab; "
            "install a newer pdlab"
        )
    if revision != head and not older_is_fine:
        raise StoreError(
            f"{url.database} is a store of revision {revision}, older than the {head} of this pdlab; "
            "run 'pdlab db upgrade'"
        )
