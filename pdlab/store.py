"""Databases, transactions and the only SELECTs.

Two engines stand on one SQLite file: the writer's transactions take the lock when they begin, so that
writers queue up instead of failing; the reader's do not.
"""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy.orm import Session, selectinload
from sqlalchemy.pool import StaticPool

from pdlab.errors import StoreError, UnknownName
from pdlab.models import (
    Aggregate,
    Calibration,
    Mixture,
    MixtureComponent,
    PackingTest,
    Prediction,
    PredictionCalibration,
    Run,
    RunState,
    SieveAnalysis,
)

DEFAULT_URL = "sqlite:///pdlab.db"
ENDED = ("done", "failed")
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
    inside = Path(__file__).parent / "migrations"
    folder = inside if inside.is_dir() else Path(__file__).parent.parent / "migrations"
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


_WITH_TESTS = (
    selectinload(Aggregate.sieve_analyses).selectinload(SieveAnalysis.results),
    selectinload(Aggregate.packing_tests),
)


def add_all(session: Session, rows: Sequence[Any]) -> None:
    """Add rows and give them their keys."""
    session.add_all(rows)
    session.flush()


def find_aggregate(session: Session, name: str, delivery: str, exact: bool = False) -> Aggregate | None:
    """Return one delivery of an aggregate; None where the store holds none.

    An empty delivery is the one without a name, or, unless ``exact``, the only one there is.
    """
    found = {row.delivery: row for row in session.scalars(sa.select(Aggregate).where(Aggregate.name == name))}
    if not exact and not delivery and delivery not in found and len(found) == 1:
        return next(iter(found.values()))
    return found.get(delivery)


def deliveries(session: Session, name: str) -> list[str]:
    """Return the deliveries of an aggregate that the store holds, in the order of their coming."""
    return list(session.scalars(sa.select(Aggregate.delivery).where(Aggregate.name == name).order_by(Aggregate.id)))


def find_mixture(session: Session, name: str) -> Mixture | None:
    """Return a mixture by its name; None where the store holds none."""
    return session.scalars(sa.select(Mixture).where(Mixture.name == name)).first()


def aggregates(session: Session, names: Sequence[str] = ()) -> list[Aggregate]:
    """Return the newest delivery of each aggregate, of all or of the named. Raises UnknownName."""
    newest = sa.select(sa.func.max(Aggregate.id)).group_by(Aggregate.name)
    query = sa.select(Aggregate).where(Aggregate.id.in_(newest)).options(*_WITH_TESTS).order_by(Aggregate.id)
    return _named("aggregate", names, {row.name: row for row in session.scalars(query)})


def aggregates_by_id(session: Session, ids: Sequence[int]) -> list[Aggregate]:
    """Return aggregates, of whatever delivery, with their tests."""
    return list(session.scalars(sa.select(Aggregate).where(Aggregate.id.in_(ids)).options(*_WITH_TESTS)))


def mixtures(session: Session, names: Sequence[str] = ()) -> list[Mixture]:
    """Return mixtures with their components, all or the named. Raises UnknownName."""
    query = (
        sa.select(Mixture)
        .options(selectinload(Mixture.components).selectinload(MixtureComponent.aggregate))
        .options(selectinload(Mixture.packing_tests))
        .order_by(Mixture.id)
    )
    return _named("mixture", names, {row.name: row for row in session.scalars(query)})


def _named(kind: str, names: Sequence[str], found: dict[str, Any]) -> list[Any]:
    missing = [name for name in names if name not in found]
    if missing:
        known = ", ".join(sorted(found)[:8]) or "none yet"
        raise UnknownName(
            f"the store holds no {kind} named {', '.join(repr(name) for name in missing)} "
            f"(it holds: {known}); import it or correct the name"
        )
    return [found[name] for name in (dict.fromkeys(names) or found)]


def done_runs(session: Session, digests: Sequence[str]) -> dict[str, Run]:
    """Return the runs among ``digests`` that are done, by digest."""
    query = sa.select(Run).where(Run.specimen_hash.in_(digests), Run.state == "done")
    return {run.specimen_hash: run for run in session.scalars(query)}


def save_run(session: Session, run: Run, state: RunState | None) -> None:
    """Write a run, over an earlier unsuccessful try of the same specimen."""
    session.merge(run)
    session.flush()
    if state is not None:
        session.merge(state)


def runs(session: Session) -> list[Run]:
    """Return all runs, the newest first."""
    return list(session.scalars(sa.select(Run).order_by(Run.finished_at.desc(), Run.specimen_hash)))


def find_bed(session: Session, beginning: str) -> tuple[Run, RunState]:
    """Return the run whose specimen hash has this ``beginning``, 4 characters or more, and its bed.

    Raises UnknownName unless there is exactly one, and when it keeps no bed.
    """
    if not re.fullmatch("[0-9a-f]{4,64}", beginning):
        raise UnknownName(
            f"'{beginning}' cannot begin a run's hash, which takes 4 to 64 of the characters 0-9 and a-f; "
            "see 'pdlab ls runs'"
        )
    query = sa.select(Run).where(Run.specimen_hash.startswith(beginning)).order_by(Run.specimen_hash).limit(2)
    found = list(session.scalars(query))
    if not found:
        raise UnknownName(f"the store holds no run whose hash begins with {beginning}; see 'pdlab ls runs'")
    if len(found) > 1:
        raise UnknownName(
            f"the hashes of several runs begin with {beginning}, among them "
            f"{' and '.join(run.specimen_hash[: len(beginning) + 4] for run in found)}; give more characters"
        )
    bed = session.get(RunState, found[0].specimen_hash)
    if bed is None:
        raise UnknownName(
            f"run {found[0].specimen_hash[:12]} ({found[0].state}) keeps no bed; choose another, see 'pdlab ls runs'"
        )
    return found[0], bed


def calibrations(session: Session, aggregate_ids: Sequence[int] | None = None) -> list[Calibration]:
    """Return calibrations, done or failed, with their runs, the last asked for first."""
    query = (
        sa.select(Calibration)
        .where(Calibration.state.in_(ENDED))
        .options(selectinload(Calibration.runs), selectinload(Calibration.packing_test))
        .options(selectinload(Calibration.aggregate).options(*_WITH_TESTS))
        .order_by(Calibration.requested_at.desc(), Calibration.id.desc())
    )
    if aggregate_ids is not None:
        query = query.where(Calibration.aggregate_id.in_(aggregate_ids))
    return list(session.scalars(query))


def predictions(session: Session, mixture_ids: Sequence[int] | None = None) -> list[Prediction]:
    """Return predictions, done or failed, with what they rest on, the last asked for first."""
    query = (
        sa.select(Prediction)
        .where(Prediction.state.in_(ENDED))
        .options(
            selectinload(Prediction.runs),
            selectinload(Prediction.calibrations)
            .selectinload(PredictionCalibration.calibration)
            .selectinload(Calibration.aggregate)
            .options(*_WITH_TESTS),
        )
        .options(selectinload(Prediction.mixture).selectinload(Mixture.packing_tests))
        .options(
            selectinload(Prediction.mixture).selectinload(Mixture.components).selectinload(MixtureComponent.aggregate)
        )
        .order_by(Prediction.requested_at.desc(), Prediction.id.desc())
    )
    if mixture_ids is not None:
        query = query.where(Prediction.mixture_id.in_(mixture_ids))
    return list(session.scalars(query))


def newest_test(tests: Sequence[PackingTest]) -> PackingTest | None:
    """Return the current density test of a material."""
    return max(tests, key=lambda test: test.id, default=None)
