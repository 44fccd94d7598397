"""Stored runs repeated: equal to the bit here, close elsewhere, told apart by engine; and nothing written."""

import io
import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import ThreadsPool

from pdlab import packing
from pdlab.batch.runner import Repeater, Runner
from pdlab.errors import InputError
from pdlab.experiments import Verified, verify
from pdlab.models import Run, RunState
from pdlab.specimen import Packing, Species, Specimen, with_seeds
from pdlab.store import Store, open_store

SMALL = Specimen((Species(1.0, 0.3, 100),), 4.0, 1)
OTHER = Specimen((Species(1.0, 0.1, 100),), 4.0, 1)
Kept = tuple[Run, RunState | None]


@pytest.fixture(scope="module")
def six_beds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with four beds of one specimen and two of another, by the engine."""
    path = tmp_path_factory.mktemp("beds") / "lab.db"
    target = open_store(str(path))
    done = Runner(target, ThreadsPool(1))(with_seeds(SMALL, [1, 2, 3, 4]) + with_seeds(OTHER, [1, 2]))
    assert all(isinstance(one, Packing) for one in done)
    target.close()
    return path


@pytest.fixture
def beds(six_beds: Path, tmp_path: Path) -> Store:
    """A copy of that store to spoil."""
    return open_store(str(shutil.copy(six_beds, tmp_path / "lab.db")))


def repeated(target: Store, *arguments: Any, **more: Any) -> dict[str, Verified]:
    again = Repeater(target, ThreadsPool(1))
    found = verify(target, again.repeat, again.engine_version, *arguments, **more)
    again.close()
    return {one.specimen_hash: one for one in found}


def stored(target: Store) -> Callable[[Sequence[Specimen]], list[Kept]]:
    """Stands for repeating on this machine: answers what the store holds, its bed written anew."""

    def repeat(specimens: Sequence[Specimen]) -> list[Kept]:
        out = []
        with target.read() as session:
            for specimen in specimens:
                run = session.get(Run, specimen.digest(packing.VERSION))
                bed = session.get(RunState, specimen.digest(packing.VERSION))
                assert run is not None
                values = {column.name: getattr(run, column.name) for column in sa.inspect(Run).columns}
                here = packing.fingerprint()
                out.append((Run(**values | {"numba_version": here["numba"], "processor": here["cpu"]}), bed))
        return out

    return repeat


def spoil(target: Store, digest: str, **values: Any) -> None:
    with target.write() as session:
        session.execute(sa.update(Run).where(Run.specimen_hash == digest).values(**values))


def test_every_run_repeats_to_the_bit_and_the_store_stays_as_it_is(beds: Store, tmp_path: Path) -> None:
    with beds.read() as session:
        before = [(run.specimen_hash, run.finished_at, run.seconds) for run in session.scalars(sa.select(Run))]
    found = repeated(beds)
    assert {one.verdict for one in found.values()} == {"equal"}
    assert len(found) == 6
    with beds.read() as session:
        assert before == [(run.specimen_hash, run.finished_at, run.seconds) for run in session.scalars(sa.select(Run))]


@pytest.mark.parametrize("name", ["packing_density", "coordination_number", "steps"])
def test_a_number_that_is_off_in_its_last_bit_is_found(beds: Store, name: str) -> None:
    digest = SMALL.digest(packing.VERSION)
    with beds.read() as session:
        run = session.get(Run, digest)
        assert run is not None
        value = getattr(run, name)
    spoil(beds, digest, **{name: value + 1 if name == "steps" else float(np.nextafter(value, 1.0))})
    found = verify(beds, _repeat_but(beds, digest, **{name: value}), packing.VERSION)
    assert {one.specimen_hash: one.message for one in found if one.verdict == "differs"} == {
        digest: f"not equal: {name}"
    }


def _repeat_but(target: Store, digest: str, **values: Any) -> Callable[[Sequence[Specimen]], list[Kept]]:
    """Repeat as the store has it, but for some values of one run."""
    known = stored(target)

    def repeat(specimens: Sequence[Specimen]) -> list[Kept]:
        kept = known(specimens)
        for run, _ in kept:
            if run.specimen_hash == digest:
                for name, value in values.items():
                    setattr(run, name, value)
        return kept

    return repeat


def test_one_sphere_moved_by_one_bit_is_found_by_the_engine(beds: Store) -> None:
    digest = SMALL.digest(packing.VERSION)
    with beds.write() as session:
        bed = session.get(RunState, digest)
        assert bed is not None
        with np.load(io.BytesIO(bed.archive)) as archive:
            place, species = archive["place"].copy(), archive["species"]
        place[17, 2] = np.nextafter(place[17, 2], 0.0)
        out = io.BytesIO()
        np.savez_compressed(out, place=place, species=species)
        bed.archive = out.getvalue()
    found = repeated(beds)
    assert [one.specimen_hash for one in found.values() if one.verdict == "differs"] == [digest]
    assert found[digest].message == "not equal: the bed"


def test_on_another_machine_three_standard_errors_are_allowed_and_no_more(beds: Store) -> None:
    values = []
    with beds.read() as session:
        for specimen in with_seeds(SMALL, [1, 2, 3, 4]):
            run = session.get(Run, specimen.digest(packing.VERSION))
            assert run is not None
            values.append(float(run.packing_density or 0.0))
    allowed = 3.0 * np.sqrt(2.0) * np.std(values, ddof=1)
    digest = SMALL.digest(packing.VERSION)
    spoil(beds, digest, processor="z80")
    for share, verdict in ((0.99, "within 3 standard errors"), (1.01, "differs")):
        repeat = _repeat_but(beds, digest, packing_density=values[0] + share * allowed)
        (found,) = (one for one in verify(beds, repeat, packing.VERSION) if one.specimen_hash == digest)
        assert found.verdict == verdict
        assert found.allowed == pytest.approx(allowed)
        assert found.message.startswith("deviation of its 4 seeds; made with numba ")


def test_with_fewer_than_four_seeds_the_deviation_is_pooled_and_that_is_said(beds: Store) -> None:
    digest = OTHER.digest(packing.VERSION)
    spoil(beds, digest, numba_version="0.1")
    (found,) = (one for one in verify(beds, stored(beds), packing.VERSION) if one.specimen_hash == digest)
    assert found.verdict == "within 3 standard errors"
    assert found.message.startswith("it has 2 seeds: deviation pooled over all specimens; made with numba 0.1 on ")


def test_without_two_seeds_of_anything_nothing_is_judged(tmp_path: Path) -> None:
    target = open_store(str(tmp_path / "lab.db"))
    Runner(target, ThreadsPool(1))([SMALL])
    spoil(target, SMALL.digest(packing.VERSION), processor="z80")
    (found,) = verify(target, stored(target), packing.VERSION)
    assert found.verdict == "not judged"
    assert found.message.startswith("no specimen of the store has two seeds")
    target.close()


def test_runs_of_another_engine_are_told_apart_and_not_repeated(beds: Store) -> None:
    digest = SMALL.digest(packing.VERSION)
    spoil(beds, digest, engine_version=packing.VERSION - 1)
    asked: list[Specimen] = []

    def repeat(specimens: Sequence[Specimen]) -> list[Kept]:
        asked.extend(specimens)
        return stored(beds)(specimens)

    found = {one.specimen_hash: one for one in verify(beds, repeat, packing.VERSION)}
    assert len(asked) == 5
    assert SMALL not in asked
    assert (found[digest].verdict, found[digest].repeated) == ("another engine version", None)


def test_a_specimen_that_is_not_the_one_of_its_hash_is_found(beds: Store) -> None:
    digest = SMALL.digest(packing.VERSION)
    content = json.loads(SMALL.canonical(packing.VERSION))
    spoil(beds, digest, specimen=json.dumps({**content, "seed": 9}))
    spoil(beds, OTHER.digest(packing.VERSION), specimen="{}")
    found = {one.specimen_hash: one for one in verify(beds, stored(beds), packing.VERSION)}
    assert found[digest].message == "its specimen is not the one that its hash names"
    assert [one.verdict for one in found.values()].count("differs") == 2


def test_a_sample_is_the_same_for_its_seed_and_as_large_as_asked(beds: Store) -> None:
    draws = [[one.specimen_hash for one in verify(beds, stored(beds), packing.VERSION, 3, seed)] for seed in (1, 1, 2)]
    assert [len(draw) for draw in draws] == [3, 3, 3]
    assert draws[0] == draws[1] != draws[2]
    assert len(verify(beds, stored(beds), packing.VERSION, 99)) == 6
    with pytest.raises(InputError, match="a sample of 0 runs is none"):
        verify(beds, stored(beds), packing.VERSION, 0)


def test_a_repeated_run_that_fails_differs(beds: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing.simulation, "PATIENCE", 0.5)
    found = repeated(beds, 1, 1)
    assert [one.verdict for one in found.values()] == ["differs"]
    assert "state" in next(iter(found.values())).message
    with beds.read() as session:
        assert set(session.scalars(sa.select(Run.state))) == {"done"}
