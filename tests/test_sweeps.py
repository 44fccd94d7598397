"""Sweeps in the store: what they rest on, when they are read again, what failed, wishes for them."""

import json
from collections.abc import Sequence

import pytest
from conftest import FormulaRunner
from surfaces import normal

from pdlab import store as the_store
from pdlab.errors import InputError, Segregated, ShareError, StillNeeded, UnknownName
from pdlab.experiments import Way, answering, ask_sweep, delete, report_on, show, sweep_aggregates, to_sweep
from pdlab.experiments.sweeps import SweepReport
from pdlab.models import Mixture, MixtureComponent, PackingTest, Sweep
from pdlab.plan import finish
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store

PEBBLES = ("pebbles L", "pebbles F")


def peak(bed: Specimen) -> float:
    """A PD with its densest mix at 0.65 of the coarse, 0.68."""
    coarse = bed.shares[0]
    return 0.68 - 0.25 * (coarse - 0.65) ** 2 + 0.001 * normal(bed.digest(3))


class PeakRunner(FormulaRunner):
    """Beds of equal spheres as the formula has them, those of two sizes by ``peak``, and none where ``fails``."""

    fails = False

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing]:
        found = super().__call__(specimens)
        return [
            packing
            if len(bed.species) == 1
            else Segregated("the mixture segregates")
            if self.fails
            else Packing(packing.digest, peak(bed), 5.0, 20.0, bed.shares, 0.005, "still", 1000, 1.0, 3)
            for bed, packing in zip(specimens, found, strict=True)
        ]  # type: ignore[misc]


def rows(target: Store) -> list[Sweep]:
    with target.read() as session:
        found = the_store.sweeps_by_id(session, range(1, 20))
    return sorted(found, key=lambda row: row.id)


def swept(target: Store, **how: object) -> tuple[SweepReport, PeakRunner]:
    runner = PeakRunner(target)
    return sweep_aggregates(target, runner, PEBBLES, **how), runner  # type: ignore[arg-type]


def test_a_sweep_is_kept_with_its_densest_mix_and_all_that_it_rests_on(pebbles: Store) -> None:
    report, runner = swept(pebbles)
    (row,) = rows(pebbles)
    assert report.error is None
    assert report.result is not None
    best = report.result.densest
    assert best.shares[0] == pytest.approx(0.65, abs=0.08)
    assert best.packing_density == pytest.approx(0.68, abs=0.004)
    assert (row.state, row.packing_density, row.standard_error) == ("done", best.packing_density, best.standard_error)
    assert best.input_error > 0.003
    assert [part.densest_share for part in row.components] == list(best.shares)
    assert [part.aggregate.name for part in row.components] == list(PEBBLES)
    assert {link.specimen_hash for link in row.runs} == {point.digest for point in report.result.points}
    assert {link.specimen_hash for link in row.runs} <= set(runner.asked)
    assert len(row.calibrations) == 2
    assert json.loads(row.asked or "")["rule"] == "log_mean"


def test_what_is_read_back_is_what_was_worked_out(pebbles: Store) -> None:
    report, _ = swept(pebbles)
    again, second = swept(pebbles)
    assert second.asked == []
    assert again.sweep_id == report.sweep_id == 1
    assert again.result is not None
    assert report.result is not None
    assert again.result.densest == report.result.densest
    assert again.result.next_test == report.result.next_test
    assert again.result.points == report.result.points


def test_a_filled_store_runs_nothing_even_where_no_equal_sweep_is_kept(pebbles: Store) -> None:
    report, _ = swept(pebbles)
    delete(pebbles, "sweep:1", "me")
    assert rows(pebbles) == []
    again, runner = swept(pebbles)
    asked = set(runner.asked)
    assert again.result is not None
    assert report.result is not None
    assert asked == {point.digest for point in report.result.points}
    assert again.result.densest.shares == report.result.densest.shares


def test_another_wished_error_or_a_mixture_measured_since_is_a_sweep_anew(pebbles: Store) -> None:
    first, _ = swept(pebbles)
    other, _ = swept(pebbles, wished_error=0.002)
    assert other.sweep_id != first.sweep_id
    assert first.result is not None
    assert first.result.next_test is not None
    shares = first.result.next_test.shares
    with pebbles.write() as session:
        known = {row.name: row.id for row in the_store.aggregates(session)}
        parts = [
            MixtureComponent(position=k, aggregate_id=known[name], solid_volume_share=share)
            for k, (name, share) in enumerate(zip(PEBBLES, shares, strict=True))
        ]
        test = PackingTest(compaction="loose", packing_density=0.67, raw_text="")
        the_store.add_all(session, [Mixture(name="the next", components=parts, packing_tests=[test])])
    later, _ = swept(pebbles)
    assert later.sweep_id not in (first.sweep_id, other.sweep_id)
    assert later.result is not None
    assert later.result.next_test is not None
    assert abs(later.result.next_test.shares[0] - shares[0]) >= 0.02


def test_a_measured_mixture_is_not_what_is_to_be_tested_next(pebbles: Store) -> None:
    report, _ = swept(pebbles)  # L + F 1:1 was measured
    assert report.result is not None
    assert report.result.next_test is not None
    assert min(abs(report.result.next_test.shares[0] - known) for known in (0.0, 0.5, 1.0)) >= 0.02


def test_a_sweep_whose_beds_all_fail_is_kept_with_its_reason_and_once(pebbles: Store) -> None:
    for _ in range(2):
        runner = PeakRunner(pebbles)
        runner.fails = True
        report = sweep_aggregates(pebbles, runner, PEBBLES)
        assert isinstance(report.error, Segregated)
        assert report.state == "failed"
    (row,) = rows(pebbles)
    assert (row.state, row.message, len(row.calibrations), row.runs) == ("failed", "the mixture segregates", 2, [])
    assert [part.densest_share for part in row.components] == [None, None]


def test_what_a_sweep_rests_on_is_not_deleted_and_show_follows_it_down(pebbles: Store) -> None:
    report, _ = swept(pebbles)
    assert report.result is not None
    run = report.result.points[0].digest
    for what in ("aggregate:pebbles L", "calibration:1", f"run:{run[:12]}"):
        with pytest.raises(StillNeeded, match="sweep:1"):
            delete(pebbles, what, "me")
    facts = show(pebbles, "sweep:1")
    assert [part["aggregate"]["name"] for part in facts["components"]] == list(PEBBLES)
    assert facts["components"][0]["densest_share"] == report.result.densest.shares[0]
    assert {one["address"] for one in facts["calibrations"]} == {"calibration:1", "calibration:2"}
    assert run in {one["specimen_hash"] for one in facts["runs"]}
    assert show(pebbles, "aggregate:pebbles L")["rests_on_it"]["sweep"] == ["1"]


def test_what_cannot_be_swept_is_said_before_anything_runs(pebbles: Store) -> None:
    runner = PeakRunner(pebbles)
    with pytest.raises(ShareError, match="2 to 5 aggregates, not 1"):
        sweep_aggregates(pebbles, runner, ["pebbles L", "pebbles L"])
    with pytest.raises(UnknownName):
        sweep_aggregates(pebbles, runner, ["pebbles L", "sand"])
    with pytest.raises(InputError, match="geometric reference"):
        sweep_aggregates(pebbles, runner, PEBBLES, Way("static"))
    with pytest.raises(InputError, match="take both above 0"):
        sweep_aggregates(pebbles, runner, PEBBLES, wished_error=-1.0)
    assert runner.asked == []
    assert rows(pebbles) == []


def test_an_aggregate_that_is_not_calibrated_fails_the_sweep_with_its_reason(pebbles: Store) -> None:
    with pebbles.write() as session:
        (one,) = the_store.aggregates(session, ["pebbles F"])
        one.packing_tests[0].voids_percent = 70.0
    report, _ = swept(pebbles)
    assert report.error is not None
    assert "aggregate 'pebbles F' is not calibrated" in str(report.error)
    assert rows(pebbles)[0].state == "failed"


def test_a_wish_for_a_sweep_is_answered_in_its_row_and_read_the_next_time(pebbles: Store) -> None:
    runner = PeakRunner(pebbles)
    wanted = to_sweep(pebbles, PEBBLES, Way())
    wish = ask_sweep(pebbles, wanted, Way(), 0.001, None, 3)
    assert wish == ask_sweep(pebbles, wanted, Way(), 0.001, None, 3) == ("sweep", 1)
    with pebbles.write() as session:
        assert the_store.claim_wishes(session, "a runner", 5, lambda _: False) == [("sweep", 1)]
    report = finish(answering(pebbles, ("sweep", 1), "a runner", 3), runner)
    assert isinstance(report, SweepReport)
    assert (report.sweep_id, report.state) == (1, "done")
    found = ask_sweep(pebbles, wanted, Way(), 0.001, None, 3)
    assert isinstance(found, SweepReport)
    assert found.sweep_id == 1
    told = report_on(pebbles, ("sweep", 1))
    assert isinstance(told, SweepReport)
    assert told.error is None
    assert len(rows(pebbles)) == 1
