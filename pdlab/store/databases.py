"""The two databases: their addresses, their engines, and what their errors mean to people.

SQLite: two engines stand on one file; the writer's transactions take the lock when they begin, so that
writers queue up instead of failing, and the reader's do not. PostgreSQL: the same by an advisory lock.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.pool import StaticPool

from pdlab.errors import StoreAway, StoreError

DEFAULT_URL = "sqlite:///pdlab.db"
LOCK_TIMEOUT = 30.0
"""Seconds that a writer waits for another."""
CACHE = 64_000
"""Most KiB of a SQLite file that a connection keeps in memory."""
CONNECT_TIMEOUT = 10
"""Seconds that a PostgreSQL server has to answer, unless the address says connect_timeout."""
WRITERS = 0x70646C6162  # "pdlab"
"""The advisory lock that a writer of a PostgreSQL store holds."""
MOUNTS = Path("/proc/self/mountinfo")
NETWORK = (
    "9p", "afs", "beegfs", "ceph", "cifs", "davfs", "fuse.ceph", "fuse.davfs2", "fuse.glusterfs", "fuse.rclone",
    "fuse.s3fs", "fuse.sshfs", "gpfs", "lustre", "ncpfs", "nfs", "nfs4", "smb3", "smbfs", "vboxsf",
)  # fmt: skip
"""File systems that other machines write to as well: SQLite's locks do not reach across them."""
REMEDIES = (
    ("file is not a database", "choose another file with --store"),
    ("disk image is malformed", "put a backup in its place"),
    ("database is locked|lock timeout", "end what else writes to it, or try again"),
    ("disk is full|No space left|could not extend file", "make room on the disk"),
    ("readonly|read-only|unable to open|permission denied|must be owner", "allow reading and writing it"),
    ("no password supplied", "give the password in the address, in PGPASSWORD or in ~/.pgpass"),
    ("password authentication failed", "correct the user or the password"),
    ("no pg_hba.conf entry", "let the server accept this user from this machine (pg_hba.conf)"),
    ('database ".*" does not exist', "create it with createdb, or correct its name"),
    ('role ".*" does not exist', "correct the user, or create it with createuser"),
    ("failed to resolve host|could not translate host name", "correct the host"),
    ("refused|timeout|No such file|unreachable", "start the server, or correct host and port"),
    ("invalid connection option|invalid .* value", "correct what stands behind the '?' of the address"),
)
"""What drivers say, as regular expressions, and what to do about it."""


AWAY = (
    "database is locked|lock timeout|refused|timeout|unreachable|No such file|terminat|closed the connection|"
    "connection is closed|starting up|shutting down|could not receive|Connection reset|Broken pipe|recovery mode"
)
"""What drivers say of a database that may answer later, as a regular expression."""


def store_url(given: str | os.PathLike[str] | None) -> str:
    """Return the store's URL: the one given, else PDLAB_STORE, else pdlab.db in this folder.

    A path without a scheme is a SQLite file. The URL may hold a password: print ``shown_url``.
    """
    url = (os.fspath(given) if given else None) or os.environ.get("PDLAB_STORE") or DEFAULT_URL
    return url if ":" in url.replace(":\\", "") else f"sqlite:///{url}"


def parse(url: str) -> sa.URL:
    """Return the parts of a store's address. Raises StoreError, which shows no password."""
    advice = "write sqlite:///FILE, a path, or postgresql://USER@HOST/DATABASE"
    scheme = f"'{url.partition(':')[0]}:...'"  # what follows may hold a password in the wrong place
    try:
        parsed = sa.make_url(url)
        backend = parsed.get_backend_name()
    except (sa.exc.ArgumentError, ValueError):
        raise StoreError(f"{scheme} is no store address; {advice}") from None
    if "@" in (parsed.host or ""):
        raise StoreError(f"{scheme} has more than one '@'; write one that belongs to the password as %40")
    if backend not in ("sqlite", "postgresql") or parsed.drivername not in (backend, f"{backend}+{_driver(backend)}"):
        raise StoreError(f"'{parsed.drivername}' stores cannot be opened by this version; {advice}")
    return parsed


def _driver(backend: str) -> str:
    return "pysqlite" if backend == "sqlite" else "psycopg"


def is_sqlite(url: sa.URL) -> bool:
    """Tell a SQLite file from a PostgreSQL database."""
    return url.get_backend_name() == "sqlite"


def in_memory(url: sa.URL) -> bool:
    """Tell a SQLite database that ends with its connection."""
    return is_sqlite(url) and url.database in (None, "", ":memory:")


def identity(given: str | os.PathLike[str] | None) -> tuple[int, ...] | None:
    """Return what tells a store's SQLite file from another in its place, () where it is no file, None where it is gone.

    An open connection goes on with a file that was deleted, and what it writes is lost with it; another file in its
    place would be read with what the open one has not written back yet (its -wal). Raises StoreError.
    """
    url = parse(store_url(given))
    if not is_sqlite(url) or in_memory(url):
        return ()
    try:
        found = os.stat(url.database or "")
    except OSError:
        return None
    return found.st_dev, found.st_ino


def shown(url: sa.URL) -> str:
    """Return an address as it may be printed and logged: with *** for passwords, which libpq takes as options too."""
    secret = [key for key in url.query if "password" in key]
    return url.update_query_dict(dict.fromkeys(secret, "***")).render_as_string(hide_password=True)


def shown_url(given: str | os.PathLike[str] | None) -> str:
    """Return the store's URL as it may be printed; see ``store_url``. Raises StoreError."""
    return shown(parse(store_url(given)))


def engine(url: sa.URL, writing: bool = False, foreign_keys: bool = True) -> sa.Engine:
    """Return an engine whose transactions are a reader's (one state, seen whole) or a writer's (one at a time).

    ``foreign_keys``: whether SQLite checks them at once. Raises StoreError.
    """
    if is_sqlite(url):
        return _sqlite_engine(url, "BEGIN IMMEDIATE" if writing else "BEGIN", foreign_keys)
    return _postgresql_engine(url, writing)


def _sqlite_engine(url: sa.URL, begin: str, foreign_keys: bool) -> sa.Engine:
    memory = in_memory(url)
    pool: dict[str, Any] = {"poolclass": StaticPool} if memory else {}
    made = sa.create_engine(url, connect_args={"timeout": LOCK_TIMEOUT}, **pool)

    @sa.event.listens_for(made, "connect")
    def prepare(connection: Any, _: Any) -> None:
        connection.isolation_level = None  # transactions begin below, not when the driver thinks so
        if begin == "BEGIN IMMEDIATE" and not memory:
            connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute(f"PRAGMA cache_size=-{CACHE}")
        connection.execute(f"PRAGMA foreign_keys={'ON' if foreign_keys else 'OFF'}")

    @sa.event.listens_for(made, "begin")
    def start(connection: sa.Connection) -> None:
        connection.exec_driver_sql(begin)

    return made


def _postgresql_engine(url: sa.URL, writing: bool) -> sa.Engine:
    reader = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
    connect: dict[str, Any] = {"client_encoding": "utf8"}
    if "connect_timeout" not in url.query:
        connect["connect_timeout"] = CONNECT_TIMEOUT
    try:
        made = sa.create_engine(
            url, connect_args=connect, pool_pre_ping=True, execution_options={} if writing else reader
        )
    except ImportError as error:
        raise StoreError(
            f"{shown(url)} needs a driver that is not installed ({error}); install it with "
            "pip install 'pdlab[postgres]'"
        ) from error
    if writing:

        @sa.event.listens_for(made, "begin")
        def start(connection: sa.Connection) -> None:
            # read committed: what is read after the lock was waited for is what the writer before left
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = {int(1000 * LOCK_TIMEOUT)}")
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITERS})")

    return made


@contextmanager
def connected(url: sa.URL, writing: bool = False, foreign_keys: bool = True) -> Iterator[sa.Connection]:
    """Give one connection in one transaction, kept when the block ends well; see ``engine``. Raises StoreError."""
    opened = engine(url, writing, foreign_keys)
    try:
        with named_errors(shown(url)), opened.begin() as connection:
            yield connection
    finally:
        opened.dispose()


def refuse_network_drive(path: Path) -> None:
    """Raise StoreError where a SQLite file would stand on a network drive."""
    kind = file_system(path)
    if kind in NETWORK:
        raise StoreError(
            f"{path} lies on a network drive ({kind}), where SQLite cannot keep writers apart; choose a file on a disk "
            "of this machine, or a PostgreSQL store for several machines"
        )


def file_system(path: Path) -> str:
    """Return the type of the file system that holds a path, as Linux names it; '' where that is not told."""
    try:
        lines = MOUNTS.read_text(errors="surrogateescape").splitlines()
    except OSError:
        return ""
    path, found = path.resolve(), [(0, 0, "")]
    for k, line in enumerate(lines):
        mount, _, kind = line.partition(" - ")
        place = Path(re.sub(r"\\([0-7]{3})", lambda code: chr(int(code[1], 8)), mount.split()[4]))
        if path.is_relative_to(place):
            found.append((len(place.parts), k, kind.split()[0]))  # a later mount hides an earlier one
    return max(found)[2]


@contextmanager
def named_errors(name: str) -> Iterator[None]:
    """Turn what the database refuses or cannot do now (locked, disk full, no such host) into a StoreError."""
    try:
        yield
    except sa.exc.DBAPIError as error:
        if not _is_state_of_the_database(error):
            raise
        raise refusal(name, error) from error


def _is_state_of_the_database(error: sa.exc.DBAPIError) -> bool:
    """Tell errors of the place and the moment from statements that are wrong and rows that cannot be."""
    if isinstance(error, sa.exc.ProgrammingError):
        return getattr(error.orig, "sqlstate", "") in (None, "42501")  # no connection; insufficient privilege
    return isinstance(error, sa.exc.OperationalError | sa.exc.InternalError) or type(error) is sa.exc.DatabaseError


def reason(error: BaseException | None) -> str:
    """Return what a driver says, on one line and without the statement."""
    return " ".join(str(getattr(error, "orig", None) or error).split())


def remedy(error: BaseException | None) -> str | None:
    """Return what to do about a driver's error; None for one that is not of the place and the moment."""
    return next((text for pattern, text in REMEDIES if re.search(pattern, reason(error))), None)


def refusal(name: str, error: BaseException | None) -> StoreError:
    """Return a driver's error as one sentence about the store of this name, with what to do."""
    advice = remedy(error) or "end what else uses it, allow reading and writing it, or choose another --store"
    if "file is not a database" in reason(error):
        return StoreError(f"{name} is no pdlab store ({reason(error)}); {advice}")
    kind = StoreAway if re.search(AWAY, reason(error), re.IGNORECASE) else StoreError
    return kind(f"the store {name} cannot be used ({reason(error)}); {advice}")
