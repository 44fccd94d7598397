"""Tables of mixtures: every row answered once, whatever stops, and only what is missing is run."""

import csv
import gc
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import sqlalchemy as sa
from conftest import FormulaPool, both

from pdlab import experiments, packing
from pdlab.batch import chunks
from pdlab.batch.many import Survey, Told, predict_table, survey
from pdlab.batch.runner import Runner
from pdlab.errors import InputError, RunDiverged, TableError
from pdlab.experiments import Way, effort, register
from pdlab.frames import PREDICTION_COLUMNS
from pdlab.lab import SHIPPED, Lab
from pdlab.models import Calibration, Mixture, Prediction, Run
from pdlab.specimen import Specimen
from pdlab.store import Store
from pdlab.tables import read_path, slices

Rows = list[tuple[str, str, float]]


class Counting(FormulaPool):
    """Notes every bed that is run; those of the seeds ``bad`` fail."""

    def __init__(self, bad: tuple[int, ...] = (), stop_after: int | None = None) -> None:
        self.run, self.bad, self.stop_after = list[str](), bad, stop_after

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        self.run.append(specimen.digest(packing.VERSION))
        if self.stop_after is not None and len(self.run) > self.stop_after:
            raise KeyboardInterrupt
        if len(specimen.species) > 1 and specimen.seed in self.bad:
            future = Future[chunks.Advanced]()
            future.set_exception(RunDiverged("a sphere left the box"))
            return future
        return super().submit(specimen, state, steps, threads)


def blends(count: int, names: tuple[str, str] = ("pebbles L", "pebbles F")) -> Rows:
    """So many mixtures of two aggregates, of which each has its own proportions."""
    shares = [round(0.2 + 0.6 * k / count, 4) for k in range(count)]
    return [
        (f"mix {k}", name, round(share, 4))
        for k, first in enumerate(shares)
        for name, share in zip(names, (first, 1.0 - first), strict=True)
    ]


def write_table(path: Path, rows: Rows) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("mixture", "aggregate", "solid_volume_share"), *rows])
    return path


@pytest.fixture
def filled(opened: Store) -> Store:
    register(opened, read_path(SHIPPED))
    return opened


@pytest.fixture
def lab_of(filled: Store, address: str) -> Iterator[Callable[[FormulaPool], Lab]]:
    labs = list[Lab]()

    def make(pool: FormulaPool) -> Lab:
        lab = Lab(address, workers=1)
        lab.runner.pool = pool
        labs.append(lab)
        return lab

    yield make
    for lab in labs:
        lab.close()


def count(target: Store, table: Any) -> int:
    with target.read() as session:
        return session.scalar(sa.select(sa.func.count()).select_from(table)) or 0


def read(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, dtype=str, keep_default_na=False)


@both
def test_every_mixture_has_its_row_in_the_order_of_the_table(
    lab_of: Callable[[FormulaPool], Lab], tmp_path: Path
) -> None:
    table, pool = write_table(tmp_path / "in.csv", blends(30)), Counting()
    summary = lab_of(pool).batch(table, tmp_path / "out.csv")
    out = read(tmp_path / "out.csv")
    assert list(out.columns) == list(PREDICTION_COLUMNS)
    assert list(out["mixture"]) == [f"mix {k}" for k in range(30)]
    assert set(out["state"]) == {"done"}
    assert (summary.mixtures, summary.predicted, summary.read, summary.failed) == (30, 30, 0, 0)
    assert summary.runs == len(pool.run) == len(set(pool.run))
    assert summary.sphere_steps > 0


@both
def test_a_table_that_was_predicted_is_read_and_nothing_is_written_to_the_store(
    lab_of: Callable[[FormulaPool], Lab], filled: Store, tmp_path: Path
) -> None:
    table = write_table(tmp_path / "in.csv", blends(30))
    lab_of(Counting()).batch(table, tmp_path / "out.csv")
    text = (tmp_path / "out.csv").read_text()
    before = [count(filled, table) for table in (Run, Mixture, Calibration, Prediction)]
    pool = Counting()
    summary = lab_of(pool).batch(table, tmp_path / "out.csv")
    assert (summary.read, summary.runs, pool.run) == (30, 0, [])
    assert (tmp_path / "out.csv").read_text() == text
    assert [count(filled, table) for table in (Run, Mixture, Calibration, Prediction)] == before


def test_a_table_that_was_stopped_goes_on_and_runs_only_what_is_missing(
    lab_of: Callable[[FormulaPool], Lab], filled: Store, tmp_path: Path
) -> None:
    table = write_table(tmp_path / "in.csv", blends(30))
    first, second = Counting(stop_after=60), Counting()
    with pytest.raises(KeyboardInterrupt):
        lab_of(first).batch(table, tmp_path / "out.csv")
    there = read(tmp_path / "out.csv")
    assert 0 < len(there) < 30, "rows stand in the file as they come"
    with filled.read() as session:
        done = set(session.scalars(sa.select(Run.specimen_hash).where(Run.state == "done")))
        states = Counter(session.scalars(sa.select(Prediction.state)))
    assert states.keys() <= {"done", "cancelled"}
    summary = lab_of(second).batch(table, tmp_path / "out.csv")
    assert not done & set(second.run)
    assert summary.read >= len(there)
    assert summary.read + summary.predicted == 30
    out = read(tmp_path / "out.csv")
    assert list(out["mixture"]) == [f"mix {k}" for k in range(30)]
    assert count(filled, Run) == len(done | set(second.run))


def test_a_row_that_fails_says_why_and_stops_nobody(lab_of: Callable[[FormulaPool], Lab], tmp_path: Path) -> None:
    rows = blends(3)
    rows[2:2] = [("unknown", "gold", 0.5), ("unknown", "pebbles F", 0.5), ("much", "pebbles L", 0.9)]
    rows[5:5] = [("much", "pebbles F", 0.2), ("far", "pebbles L", 0.999999), ("far", "pebbles F", 0.000001)]
    rows += [("mix 0", "pebbles L", 1.0)]
    summary = lab_of(Counting()).batch(write_table(tmp_path / "in.csv", rows), tmp_path / "out.csv")
    out = read(tmp_path / "out.csv").to_dict("records")
    assert [row["mixture"] for row in out] == ["mix 0", "unknown", "much", "far", "mix 1", "mix 2", "mix 0"]
    assert [row["state"] for row in out] == ["done", "failed", "failed", "failed", "done", "done", "failed"]
    assert "no aggregate named 'gold'" in out[1]["message"]
    assert "sum to" in out[2]["message"]
    assert out[3]["message"]
    assert "stands in row 2 already" in out[6]["message"]
    assert (summary.predicted, summary.failed) == (3, 4)


def test_a_bed_that_fails_fails_its_row_alone(lab_of: Callable[[FormulaPool], Lab], tmp_path: Path) -> None:
    pool = Counting(bad=(2,))
    summary = lab_of(pool).batch(write_table(tmp_path / "in.csv", blends(3)), tmp_path / "out.csv")
    out = read(tmp_path / "out.csv")
    assert set(out["state"]) == {"failed"}
    assert set(out["message"]) == {"a sphere left the box"}
    assert summary.failed == 3


def test_equal_mixtures_under_several_names_share_their_beds(
    lab_of: Callable[[FormulaPool], Lab], tmp_path: Path
) -> None:
    rows = [(f"copy {k} of {name}", *rest) for k in range(5) for name, *rest in blends(2)]
    pool = Counting()
    summary = lab_of(pool).batch(write_table(tmp_path / "in.csv", rows), tmp_path / "out.csv")
    assert summary.predicted == 10
    assert len(pool.run) == len(set(pool.run))
    out = read(tmp_path / "out.csv")
    assert out.groupby(out["mixture"].str[-5:])["packing_density"].nunique().tolist() == [1, 1]


def test_a_file_that_is_no_earlier_output_is_refused_before_anything_runs(
    lab_of: Callable[[FormulaPool], Lab], tmp_path: Path
) -> None:
    table, pool = write_table(tmp_path / "in.csv", blends(3)), Counting()
    (tmp_path / "thesis.csv").write_text("years,of,work\n1,2,3\n")
    with pytest.raises(InputError, match="is no output of these columns"):
        lab_of(pool).batch(table, tmp_path / "thesis.csv")
    with pytest.raises(TableError):
        lab_of(pool).batch(tmp_path / "thesis.csv", tmp_path / "out.csv")
    assert (tmp_path / "thesis.csv").read_text() == "years,of,work\n1,2,3\n"
    assert pool.run == []


@both
def test_a_plan_says_what_will_be_run_and_writes_nothing(
    lab_of: Callable[[FormulaPool], Lab], filled: Store, tmp_path: Path
) -> None:
    table, pool = write_table(tmp_path / "in.csv", [*blends(4), ("bad", "gold", 1.0)]), Counting()
    lab = lab_of(pool)
    lab.calibrate()
    before = [count(filled, table) for table in (Run, Mixture, Calibration, Prediction)]
    known = len(pool.run)
    plan = lab.plan(table)
    assert [count(filled, table) for table in (Run, Mixture, Calibration, Prediction)] == before
    assert (int(plan.pending.sum()), plan.read, plan.failed) == (4, 0, 1)
    summary = lab.batch(table, tmp_path / "out.csv")
    assert plan.estimate.runs == summary.runs == len(pool.run) - known == 16
    again = lab.plan(table)
    assert (int(again.pending.sum()), again.read, again.estimate.runs) == (0, 4, 0)


def test_a_plan_counts_equal_beds_once_wherever_they_stand_in_the_table(filled: Store, tmp_path: Path) -> None:
    rows = [(f"copy {k} of {name}", *rest) for k in range(3) for name, *rest in blends(2)]
    table = slices(write_table(tmp_path / "in.csv", rows), size=1)  # type: ignore[arg-type]
    runner = Runner(filled, Counting())
    *_, plan = survey(runner, table, Way(), rehearse=True)
    once = slices(write_table(tmp_path / "once.csv", blends(2)), size=1)
    *_, least = survey(runner, once, Way(), rehearse=True)
    assert isinstance(plan, Survey)
    assert isinstance(least, Survey)
    assert plan.estimate.runs == least.estimate.runs


def test_a_plan_counts_the_curves_of_aggregates_that_are_not_calibrated(
    lab_of: Callable[[FormulaPool], Lab], tmp_path: Path
) -> None:
    plan = lab_of(Counting()).plan(write_table(tmp_path / "in.csv", blends(4)))
    assert plan.estimate.runs > 16
    low, high = plan.estimate.seconds(8).value, plan.estimate.seconds(1).value
    assert low < high


def test_a_frame_is_predicted_row_by_row_too(lab_of: Callable[[FormulaPool], Lab]) -> None:
    rows = [*blends(3), ("bad", "gold", 1.0)]
    frame = pd.DataFrame(rows, columns=["mixture", "aggregate", "solid_volume_share"])
    out = lab_of(Counting()).predict(frame)
    assert list(out["mixture"]) == ["mix 0", "mix 1", "mix 2", "bad"]
    assert list(out["state"]) == ["done", "done", "done", "failed"]
    assert lab_of(Counting()).predict(frame).equals(out)


def test_what_another_predicts_meanwhile_is_read(filled: Store, tmp_path: Path) -> None:
    table = slices(write_table(tmp_path / "in.csv", blends(6)))
    one, other = Runner(filled, Counting()), Runner(filled, Counting())
    found: list[Told | Survey] = list(survey(one, table, Way()))
    pending = next(each for each in found if isinstance(each, Survey)).pending
    assert sum(told.fresh for told in predict_table(other, table, Way())) == 6
    from pdlab.batch.many import predict_pending

    told = list(predict_pending(one, table, pending, Way()))
    assert sorted(each.number for each in told) == list(range(6))
    assert not any(each.fresh for each in told)
    assert one.pool.run == []  # type: ignore[attr-defined]


def test_memory_does_not_grow_with_the_table(filled: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effort, "MOST", 20)  # runs that a plan learns from: of the store, whatever the table

    def held(rows: int) -> int:
        """The memory that is held all through the last third of the rows: what a cache takes and gives back is not."""
        named = [(f"of {rows}, {name}", aggregate, share) for name, aggregate, share in blends(rows)]
        table, levels = slices(write_table(tmp_path / "in.csv", named), size=10), list[int]()
        tracemalloc.start()
        for told in predict_table(Runner(filled, FormulaPool()), table, Way()):
            assert told.report.error is None
            if told.number % 10 == 0:
                gc.collect()
                levels.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        return min(levels[-(len(levels) // 3) :])

    held(10)  # what is loaded and compiled once
    few, most = held(20), 40 * 2_000
    many = [held(60)]
    if many[0] - few >= most:  # a table of the interpreter's that grows does so once
        many.append(held(60))
    assert many[-1] - few < most, f"{few} and {many} bytes"


def test_the_same_call_again_gives_the_same_answer_to_the_bit(
    lab_of: Callable[[FormulaPool], Lab], tmp_path: Path
) -> None:
    table = write_table(tmp_path / "in.csv", blends(5))
    names = [f"mix {k}" for k in range(5)]
    lab_of(Counting()).batch(table, tmp_path / "out.csv")
    one = lab_of(Counting()).predict(names)
    two = lab_of(Counting()).predict(names[::-1])[::-1].reset_index(drop=True)
    assert one.equals(two)
    out = read(tmp_path / "out.csv")
    assert [float(value) for value in out["packing_density"]] == list(one["packing_density"])
    assert experiments.comparisons(lab_of(Counting()).store)[-1].state == "done"
