"""Shipped runs: a first calibration waits for none, rests on rows of the store, and takes nothing that does not fit."""

import datetime as dt
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import FormulaRunner, formula_packing
from sqlalchemy import select

from pdlab.calibration import MONOSIZED, NODES, ROLLING, Ladder
from pdlab.dem import VERSION
from pdlab.errors import InputError, OutOfReach, TableError
from pdlab.experiments import Way, calibrate, register, shipped, verify
from pdlab.experiments.curves import Curves
from pdlab.lab import SHIPPED
from pdlab.models import Calibration, Run, RunState
from pdlab.plan import finish
from pdlab.specimen import LOOSE, Specimen, equal_spheres, protocol_of
from pdlab.store import Store, open_store
from pdlab.tables import read_path

LADDERS = [Ladder(method, ((1.0, 1.0),), LOOSE) for method in (MONOSIZED, ROLLING)]
BEDS = list(dict.fromkeys(bed for ladder in LADDERS for node in NODES for bed in ladder.beds(node)))
THERE = {"numba_version": "0.1", "processor": "another"}


def run(bed: Specimen, **more: Any) -> Run:
    """A run by the formula, on another machine."""
    gave = formula_packing(bed)
    same = ("packing_density", "coordination_number", "height", "largest_overlap", "rest", "steps", "seconds")
    facts = {name: getattr(gave, name) for name in same} | THERE
    moment = dt.datetime(2026, 11, 24, 12, tzinfo=dt.UTC)
    return Run(specimen_hash=gave.digest, engine_version=VERSION, seed=bed.seed, finished_at=moment, **facts | more)


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A table of runs by the formula, on both edges of a loose bed, in the place of the shipped one."""
    path = tmp_path / "table" / "runs.csv"
    shipped.write_table(path, [(bed, run(bed)) for bed in BEDS])
    monkeypatch.setattr(shipped, "TABLE", path)
    return path


def rows(target: Store) -> dict[str, Run]:
    with target.read() as session:
        return {row.specimen_hash: row for row in session.scalars(select(Run))}


def with_density(target: Store, folder: Any, density: float) -> None:
    register(
        target,
        read_path(
            folder(
                aggregates="name\nA\n",
                sieves="aggregate,aperture_mm,passing_percent\nA,16,100\nA,8,0\n",
                packing_tests=f"material,compaction,packing_density\nA,loose,{density}\n",
            )
        ),
    )


def test_a_first_calibration_runs_nothing_and_rests_on_runs_that_stand_in_the_store(
    pebbles: Store, table: Path
) -> None:
    runner = FormulaRunner(pebbles)
    reports = calibrate(pebbles, runner)
    assert [report.error for report in reports] == [None] * 3
    assert runner.asked == []
    stored = rows(pebbles)
    with pebbles.read() as session:
        evidence = [link.specimen_hash for fit in session.scalars(select(Calibration)) for link in fit.runs]
        assert session.scalars(select(RunState)).all() == []
    assert len(evidence) == 3 * 4 * len(NODES)
    for bed in BEDS[: 4 * len(NODES)]:
        row = stored[bed.digest(VERSION)]
        assert (row.state, row.specimen, row.spheres) == ("done", bed.canonical(VERSION), bed.spheres)
        assert {name: getattr(row, name) for name in THERE} == THERE
        assert (row.packing_density, row.slab_shares) == (formula_packing(bed).packing_density, "[1.0]")
    assert set(evidence) == set(stored)


def test_a_calibration_and_its_error_are_those_of_the_same_runs_made_here(
    table: Path, empty_table: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there, here = open_store("sqlite://"), open_store("sqlite://")
    for target in (there, here):
        register(target, read_path(SHIPPED))
    by_shipped = calibrate(there, FormulaRunner(there))
    monkeypatch.setattr(shipped, "TABLE", empty_table)
    runner = FormulaRunner(here)
    curves = Curves(here, VERSION)
    curves.load(LADDERS)
    finish(curves.extend({(ladder, node): 4 for ladder in LADDERS for node in NODES}), runner)
    own = calibrate(here, runner)
    assert [report.result for report in by_shipped] == [report.result for report in own]
    assert all(report.result is not None and report.result.curve_error > 0.0 for report in own)


@pytest.mark.parametrize("method", ["monosized", "auto"])
def test_a_density_out_of_reach_is_answered_without_a_run(store: Store, table: Path, folder: Any, method: str) -> None:
    with_density(store, folder, 0.40)
    runner = FormulaRunner(store)
    (report,) = calibrate(store, runner, way=Way(method))
    assert isinstance(report.error, OutOfReach)
    assert "'monosized' spans 0.5" in str(report.error)
    assert "'monosized_rolling' spans 0.4" in str(report.error)
    assert runner.asked == []


def test_more_seeds_than_are_shipped_are_run_beside_them(pebbles: Store, table: Path) -> None:
    runner = FormulaRunner(pebbles)
    (report,) = calibrate(pebbles, runner, ["pebbles L"], Way(seeds=6))
    assert report.error is None
    assert len(runner.asked) == 2 * 2  # two more at each of the nodes around
    assert not set(runner.asked) & {bed.digest(VERSION) for bed in BEDS}


def test_nothing_of_another_engine_version_is_taken(pebbles: Store, table: Path) -> None:
    runner = FormulaRunner(pebbles, VERSION + 1)
    calibrate(pebbles, runner)
    assert {row.engine_version for row in rows(pebbles).values()} == {VERSION + 1}
    assert set(runner.asked) == set(rows(pebbles))
    with pytest.raises(InputError, match=f"for compaction 'loose' and engine version {VERSION + 1}"):
        shipped.shipped_surface("loose", VERSION + 1)


def test_another_protocol_takes_nothing(pebbles: Store, table: Path) -> None:
    curves = Curves(pebbles, VERSION)
    curves.load([replace(ladder, protocol=replace(LOOSE, local_damping=0.0)) for ladder in LADDERS])
    assert rows(pebbles) == {}


def test_shipped_runs_are_written_once_and_over_nothing(store: Store, table: Path) -> None:
    under_way, own = BEDS[0], BEDS[1]
    with store.write() as session:
        session.add(run(under_way, state="running", specimen="{}", spheres=1, claimed_by="a", packing_density=None))
        session.add(run(own, state="done", specimen="{}", spheres=1, packing_density=0.5))
    Curves(store, VERSION).load(LADDERS)
    first = rows(store)
    assert len(first) == len(BEDS)
    assert (first[under_way.digest(VERSION)].state, first[under_way.digest(VERSION)].claimed_by) == ("running", "a")
    assert first[own.digest(VERSION)].packing_density == 0.5
    Curves(store, VERSION).load(LADDERS)
    assert {key: row.created_at for key, row in rows(store).items()} == {
        key: row.created_at for key, row in first.items()
    }


def _cut(table: Path) -> None:
    table.write_text("\n".join(table.read_text(encoding="utf-8").splitlines()[:-1]) + "\n", encoding="utf-8")


def _tampered(table: Path) -> None:
    table.write_text(table.read_text(encoding="utf-8").replace(",0.6", ",0.5", 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("damage", "message"),
    [(_cut, "is not as it was shipped"), (_tampered, "is not as it was shipped"), (Path.unlink, "cannot be read")],
)
def test_a_damaged_table_is_a_named_error_and_nothing_is_taken_from_it(
    pebbles: Store, table: Path, damage: Any, message: str
) -> None:
    damage(table)
    runner = FormulaRunner(pebbles)
    for report in calibrate(pebbles, runner):
        assert isinstance(report.error, TableError)
        assert message in str(report.error)
        assert "install pdlab again" in str(report.error)
    assert rows(pebbles) == {}


@pytest.mark.parametrize(("processor", "verdict"), [("another", "equal"), ("here", "within 3 standard errors")])
def test_shipped_runs_are_verified_like_any(store: Store, table: Path, processor: str, verdict: str) -> None:
    Curves(store, VERSION).load(LADDERS)

    def repeat(specimens: Sequence[Specimen]) -> list[tuple[Run, RunState | None]]:
        return [(run(bed, state="done", processor=processor), None) for bed in specimens]

    found = verify(store, repeat, VERSION)
    assert {one.verdict for one in found} == {verdict}
    assert len(found) == len(BEDS)


@pytest.mark.shipped
def test_every_shipped_run_is_named_by_its_specimen_for_the_present_engine() -> None:
    """Fails once ``dem.VERSION`` or a specimen's form has changed: run tests/validation/equal_spheres.py again."""
    table = shipped._rows(shipped.TABLE)
    for digest, row in table.items():
        bed = equal_spheres(row["friction"], row["seed"], protocol_of(row["compaction"]), row["rolling"])
        assert digest == bed.digest(VERSION)
        assert row["engine_version"] == VERSION


@pytest.mark.shipped
@pytest.mark.parametrize("compaction", ["loose", "rodded", "vibrated"])
def test_both_edges_and_the_inside_of_every_default_protocol_are_shipped(store: Store, compaction: str) -> None:
    ladders = [replace(ladder, protocol=protocol_of(compaction)) for ladder in LADDERS]
    curves = Curves(store, VERSION)
    curves.load(ladders)
    for ladder in ladders:
        known = curves.known(ladder)
        assert known is not None
        assert tuple(point.value for point in known.points) == NODES
        assert min(point.seeds for point in known.points) >= 4
        assert known.node_errors().max() < 0.002
    inside = shipped.shipped_surface(compaction, VERSION)
    assert inside.at(0.2, 0.2)[1] < 0.003
