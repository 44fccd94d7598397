"""What the store keeps when its writers are killed, and when many write at once."""

import json
import os
import random
import signal
import time
import traceback
from collections import Counter
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import sqlalchemy as sa
from conftest import FormulaPool, both
from sqlalchemy.orm import Session

from pdlab import experiments
from pdlab.batch.names import is_gone
from pdlab.batch.runner import Runner
from pdlab.batch.working import predict
from pdlab.models import Aggregate, Base, Run
from pdlab.specimen import equal_spheres
from pdlab.store import Store, find_aggregate, open_store, save_run
from pdlab.tables import read_frames

SEED, KILLS, KILLS_IN_CI = 20261124, 200, 20
LONGEST = 0.5
"""Seconds after its first acknowledgement within which a writer is killed."""
GROUP = 10
"""Aggregates of one import."""


def import_group(target: Store, number: int) -> list[str]:
    """Import aggregates with sieves and tests, and mixtures of them; return the mixtures' names."""
    names = [f"group {number} aggregate {k}" for k in range(GROUP)]
    blends = [f"group {number} mixture {k}" for k in range(GROUP // 2)]
    frames = {
        "aggregates": pd.DataFrame([{"name": name} for name in names]),
        "sieves": pd.DataFrame(
            [
                {"aggregate": name, "aperture_mm": aperture, "passing_percent": passing}
                for k, name in enumerate(names)
                for aperture, passing in ((16.0 + k + 0.001 * number, 100.0), (8.0, 40.0), (4.0, 0.0))
            ]
        ),
        "packing_tests": pd.DataFrame(
            [{"material": name, "compaction": "loose", "packing_density": 0.6} for name in names]
        ),
        "mixtures": pd.DataFrame(
            [
                {"mixture": blend, "aggregate": names[2 * k + one], "solid_volume_share": 0.5}
                for k, blend in enumerate(blends)
                for one in (0, 1)
            ]
        ),
    }
    experiments.register(target, read_frames(frames))
    return blends


def acknowledge(pipe: int) -> None:
    """Send the table and the key of every row that is written into a pipe, as soon as it is committed."""
    flushed: list[str] = []

    def note(session: Session, _: object) -> None:
        for row in [*session.new, *session.dirty]:
            key = sa.inspect(type(row)).primary_key_from_instance(row)
            flushed.append(json.dumps([row.__tablename__, key]))

    def send(_: Session) -> None:
        os.write(pipe, "".join(f"{line}\n" for line in flushed).encode())
        flushed.clear()

    sa.event.listen(Session, "after_flush", note)
    sa.event.listen(Session, "after_commit", send)


def write_until_killed(url: str, pipe: int, number: int) -> None:
    """Import, calibrate and predict, group after group, and acknowledge what is kept."""
    target = open_store(url)
    runner = Runner(target, FormulaPool())
    acknowledge(pipe)
    while True:
        blends = import_group(target, number)
        predict(runner, blends, experiments.Way(seeds=8))
        number += 1


def killed(url: str, number: int, rng: random.Random) -> list[tuple[str, list[Any]]]:
    """Start a writer, kill it at a random moment and return what it had acknowledged."""
    listen, speak = os.pipe()
    writer = os.fork()
    if writer == 0:
        os.close(listen)
        try:
            write_until_killed(url, speak, number)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)  # never return into the tests
    os.close(speak)
    with os.fdopen(listen, "rb") as told:
        heard = [told.readline()]
        time.sleep(rng.uniform(0.0, LONGEST))
        os.kill(writer, signal.SIGKILL)
        heard += told.read().splitlines(keepends=True)
    assert os.waitpid(writer, 0)[1] == signal.SIGKILL, "the writer ended by itself"
    return [tuple(json.loads(line)) for line in heard if line.endswith(b"\n")]


def check_store(url: str, acknowledged: list[tuple[str, list[Any]]]) -> None:
    """Open a store whose writer was killed, and look for everything that was acknowledged."""
    target = open_store(url)
    with target.read() as session:
        connection = session.connection()
        if connection.dialect.name == "sqlite":
            assert connection.exec_driver_sql("PRAGMA integrity_check").scalars().all() == ["ok"]
            assert connection.exec_driver_sql("PRAGMA foreign_key_check").all() == []
        for name in {name for name, _ in acknowledged}:
            table = Base.metadata.tables[name]
            there = {tuple(row) for row in session.execute(sa.select(*table.primary_key.columns))}
            lost = {tuple(key) for kind, key in acknowledged if kind == name} - there
            assert not lost, f"{name}: {sorted(lost)[:3]} were acknowledged and are gone"
        groups = Counter(name.rsplit(" aggregate", 1)[0] for name in session.scalars(sa.select(Aggregate.name)))
        assert set(groups.values()) <= {GROUP}, "an import is there in part"
        for kind in ("run", "calibration", "prediction"):
            table = Base.metadata.tables[kind]
            states = Counter(session.scalars(sa.select(table.c.state)))
            assert states.keys() <= {"done", "queued", "running"}, f"{kind}: {states}"
            held = session.scalars(sa.select(table.c.claimed_by).where(table.c.state == "running").distinct())
            assert all(is_gone(name) for name in held), f"{kind}: a lease must be waited for"
    target.close()


@pytest.mark.parametrize(
    "kills", [KILLS_IN_CI, pytest.param(KILLS, marks=pytest.mark.slow)], ids=lambda count: f"{count} kills"
)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_what_was_acknowledged_is_there_whenever_the_writer_is_killed(kills: int, tmp_path: Path) -> None:
    url, rng = f"sqlite:///{tmp_path / 'lab.db'}", random.Random(SEED)
    open_store(url).close()
    acknowledged: list[tuple[str, list[Any]]] = []
    last: Counter[str] = Counter()
    for kill in range(kills):
        news = killed(url, 1000 * kill, rng)
        acknowledged += news
        last[news[-1][0]] += 1
        check_store(url, acknowledged)
    print(f"seed {SEED}: {kills} kills, {len(acknowledged)} rows acknowledged, none lost; killed after {dict(last)}")
    assert len(last) > 1, "all kills came at the same point of the way"


def write_much(url: str, number: int, outcome: Any) -> None:
    """Do what a lab's processes do: add aggregates, add to one that all know, keep runs."""
    try:
        target = open_store(url)
        for k in range(25):
            with target.write() as session:
                shared = find_aggregate(session, "shared", "")
                assert shared is not None
                shared.shape = str(int(shared.shape or 0) + 1)
                session.add(Aggregate(name=f"{number} {k}", delivery=""))
            specimen = equal_spheres(0.3, k)  # the same runs in every process
            row = Run(
                specimen_hash=specimen.digest(1), specimen=specimen.canonical(1), engine_version=1, seed=k, spheres=9,
                state="done", packing_density=0.6,
            )  # fmt: skip
            with target.write() as session:
                save_run(session, row, None)
        outcome.put("")
    except BaseException as error:
        outcome.put(f"writer {number}: {error!r}")


def read_much(url: str, stop: Any, outcome: Any) -> None:
    """Read while others write: one state of the store in each transaction."""
    try:
        target = open_store(url)
        while not stop.is_set():
            with target.read() as session:
                before = session.scalar(sa.select(sa.func.count()).select_from(Aggregate))
                time.sleep(0.002)
                assert session.scalar(sa.select(sa.func.count()).select_from(Aggregate)) == before
        outcome.put("")
    except BaseException as error:
        outcome.put(f"reader: {error!r}")


@both
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_eight_writers_and_two_readers_lose_nothing_and_are_never_locked_out(address: str) -> None:
    target = open_store(address)
    with target.write() as session:
        session.add(Aggregate(name="shared", delivery="", shape="0"))
    target.close()
    context = get_context("fork")
    outcome, stop = context.Queue(), context.Event()
    writers = [context.Process(target=write_much, args=(address, k, outcome)) for k in range(8)]
    readers = [context.Process(target=read_much, args=(address, stop, outcome)) for _ in range(2)]
    for one in [*writers, *readers]:
        one.start()
    said = [outcome.get(timeout=120) for _ in writers]
    stop.set()
    said += [outcome.get(timeout=30) for _ in readers]
    for one in [*writers, *readers]:
        one.join()
    assert [text for text in said if text] == []
    target = open_store(address)
    with target.read() as session:
        shared = find_aggregate(session, "shared", "")
        assert shared is not None
        assert shared.shape == "200", "an update was lost"
        assert session.scalar(sa.select(sa.func.count()).select_from(Aggregate)) == 201
        assert session.scalar(sa.select(sa.func.count()).select_from(Run)) == 25
    target.close()
