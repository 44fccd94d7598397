"""The runner with the real engine and real processes, on small beds."""

import io
import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import ThreadsPool, both

from pdlab import packing
from pdlab.batch import chunks, driving, jobs, pools
from pdlab.batch.pools import ProcessPool
from pdlab.batch.progress import Progress
from pdlab.batch.runner import Runner, cores
from pdlab.errors import NotAtRest, WorkersLost
from pdlab.models import Run, RunState
from pdlab.specimen import Packing, Species, Specimen, with_seeds
from pdlab.store import Store

SMALL = Specimen((Species(1.0, 0.3, 100),), 4.0, 1)
TRIO = with_seeds(SMALL, [1, 2, 3])


@pytest.fixture
def target(opened: Store) -> Store:
    return opened


def test_spawned_processes_give_the_bytes_of_this_one_and_each_run_is_kept(target: Store, tmp_path: Path) -> None:
    shown: list[Progress] = []
    runner = Runner(target, ProcessPool(2), shown.append, threads=min(2, cores()))
    out = runner([*TRIO, TRIO[0]])
    assert runner.simulated == 3
    assert out[0] == out[3]
    here = packing.advance(TRIO[1], None, 10**9)
    assert isinstance(out[1], Packing)
    assert out[1].packing_density == packing.measure(TRIO[1], here, 0.0).packing_density
    with target.read() as session:
        state = session.get(RunState, out[1].digest)
    assert state is not None
    assert np.array_equal(np.load(io.BytesIO(state.archive))["place"], here.place)
    assert shown[0] == Progress(3, 0, 0, 0.0)
    assert replace(shown[-1], sphere_steps=0) == Progress(3, 0, 3, 1.0)
    assert shown[-1].sphere_steps == sum(100 * packing.steps for packing in out[:3] if isinstance(packing, Packing))
    assert [progress.share for progress in shown] == sorted(progress.share for progress in shown)


@both
def test_a_run_in_the_store_is_read_and_a_deleted_one_repeated_with_the_same_result(target: Store) -> None:
    first = Runner(target, ThreadsPool(1))(TRIO)
    again = Runner(target, ThreadsPool(1))
    assert again(TRIO) == first
    assert (again.simulated, again.read) == (0, 3)
    assert isinstance(first[1], Packing)
    with target.write() as session:
        session.execute(sa.delete(Run).where(Run.specimen_hash == first[1].digest))
    third = Runner(target, ThreadsPool(1))
    repeated = third(TRIO)
    assert (third.simulated, third.read) == (1, 2)
    assert isinstance(repeated[1], Packing)
    assert replace(repeated[1], seconds=0.0) == replace(first[1], seconds=0.0)


def test_short_chunks_change_no_result(target: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = packing.measure(SMALL, packing.advance(SMALL, None, 10**9), 0.0)
    monkeypatch.setattr(jobs, "CHUNK", 37_000)
    cut = Runner(target, ThreadsPool(1))([SMALL])[0]
    assert isinstance(cut, Packing)
    assert replace(cut, seconds=0.0) == whole


@both
def test_a_run_that_fails_is_kept_with_its_reason_and_stops_no_other(
    target: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = packing.advance

    def advance(specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> packing.State:
        if specimen.seed == 2 and state is not None:
            raise NotAtRest("the bed still moves")
        return real(specimen, state, steps)

    monkeypatch.setattr(packing, "advance", advance)
    monkeypatch.setattr(jobs, "CHUNK", 100_000)
    good, bad, other = Runner(target, ThreadsPool(1))(TRIO)
    assert isinstance(good, Packing)
    assert isinstance(other, Packing)
    assert isinstance(bad, NotAtRest)
    with target.read() as session:
        failed = session.scalars(sa.select(Run).where(Run.state == "failed")).one()
        assert failed.error == "the bed still moves"
        assert session.get(RunState, failed.specimen_hash) is not None
    monkeypatch.setattr(packing, "advance", real)
    repeated = Runner(target, ThreadsPool(1))(TRIO)  # a failure is tried again
    assert isinstance(repeated[1], Packing)


@both
def test_a_bed_that_does_not_come_to_rest_keeps_its_last_state(target: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing.simulation, "PATIENCE", 0.5)
    (bad,) = Runner(target, ThreadsPool(1))([SMALL])
    assert isinstance(bad, NotAtRest)
    with target.read() as session:
        kept = session.get(RunState, SMALL.digest(packing.VERSION))
        assert kept is not None
        place = np.load(io.BytesIO(kept.archive))["place"]
    assert isinstance(bad.state, packing.State)
    assert kept.steps == bad.state.steps > 0
    assert np.array_equal(place, bad.state.place)


def test_an_error_from_a_worker_brings_its_state_along() -> None:
    error = pickle.loads(pickle.dumps(NotAtRest("it moves", np.ones(3))))
    assert str(error) == "it moves"
    assert repr(error) == "NotAtRest('it moves')"
    assert np.array_equal(error.state, np.ones(3))


def test_progress_tells_steps_energy_balance_and_rises(target: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Progress] = []
    monkeypatch.setattr(jobs, "CHUNK", 40_000)
    Runner(target, ThreadsPool(1), told.append)([SMALL])
    beds = [bed for progress in told for bed in progress.beds]
    assert len(beds) > 5
    assert [bed.steps for bed in beds] == sorted({bed.steps for bed in beds})
    assert beds[0].kinetic_energy > 100.0 * beds[-1].kinetic_energy > 0.0
    assert beds[-1].out_of_balance < 0.1
    shares = [progress.share for progress in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0


def dies_once(specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> chunks.Advanced:
    """Kill the first worker process that works on seed 2."""
    mark = Path(os.environ["PDLAB_TEST_MARK"])
    if specimen.seed == 2 and not mark.exists():
        mark.touch()
        os._exit(9)
    return chunks.advance(specimen, state, steps)


def dies(specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> chunks.Advanced:
    """Kill the worker process."""
    os._exit(9)


def dies_of_the_second(specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> chunks.Advanced:
    """Kill every worker process that works on seed 2."""
    if specimen.seed == 2:
        os._exit(9)
    return chunks.advance(specimen, state, steps)


def test_a_worker_that_dies_costs_a_chunk_and_no_result(
    target: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PDLAB_TEST_MARK", str(tmp_path / "mark"))
    monkeypatch.setattr(pools, "advance", dies_once)
    runner = Runner(target, ProcessPool(2))
    assert all(isinstance(outcome, Packing) for outcome in runner(TRIO))
    assert (tmp_path / "mark").exists()
    assert runner.simulated == 3
    runner.close()


def test_workers_that_die_again_and_again_end_with_a_named_error(
    target: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driving, "LOST", 100)
    monkeypatch.setattr(driving, "LOST_POOLS", 3)
    monkeypatch.setattr(pools, "advance", dies)
    with pytest.raises(WorkersLost, match="died 3 times in a row without finishing a chunk"):
        Runner(target, ProcessPool(1))(TRIO[:1])


def test_a_bed_that_kills_its_workers_fails_alone(target: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driving, "LOST", 3)
    monkeypatch.setattr(pools, "advance", dies_of_the_second)
    runner = Runner(target, ProcessPool(2))
    first, second, third = runner(TRIO)
    assert isinstance(first, Packing)
    assert isinstance(third, Packing)
    assert isinstance(second, WorkersLost)
    assert "its worker died 3 times in a row" in str(second)
    with target.read() as session:
        states = {run.seed: run.state for run in session.scalars(sa.select(Run))}
    assert states == {1: "done", 2: "failed", 3: "done"}
    runner.close()
