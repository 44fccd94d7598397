"""Engine versions: never mixed, told apart, and worked out again with the difference."""

import math

import pytest
import sqlalchemy as sa
from conftest import FormulaRunner

from pdlab.errors import UnknownName
from pdlab.experiments import Way, calibrate, comparisons, correct, predict, refresh, summaries
from pdlab.models import Calibration, Prediction
from pdlab.store import Store, predictions


@pytest.fixture
def older(pebbles: Store) -> Store:
    predict(pebbles, FormulaRunner(pebbles, 2))
    return pebbles


def test_a_prediction_rests_on_calibrations_and_runs_of_its_own_engine_alone(older: Store) -> None:
    predict(older, FormulaRunner(older, 3))
    with older.read() as session:
        rests = [
            {row.engine_version}
            | {link.run.engine_version for link in row.runs}
            | {link.calibration.engine_version for link in row.calibrations}
            | {link.run.engine_version for source in row.calibrations for link in source.calibration.runs}
            for row in predictions(session)
        ]
    assert rests == [{3}] * 3 + [{2}] * 3


def test_results_of_an_older_engine_say_so(older: Store) -> None:
    assert [report.state for report in comparisons(older)] == ["done"] * 3
    for reports in (comparisons(older, 3), summaries(older, 3)):
        assert all("by an older engine (version 2); run 'pdlab refresh'" in report.message for report in reports)
    assert [report.state for report in comparisons(older, 3)] == ["outdated"] * 3
    calibrate(older, FormulaRunner(older, 3), ["pebbles L"])  # from now on the store itself knows a newer engine
    assert [report.state for report in comparisons(older)] == ["outdated"] * 3


def test_the_expected_error_is_not_taken_from_comparisons_of_another_engine(older: Store) -> None:
    predict(older, FormulaRunner(older, 3), ["pebbles L+M 1:1"])
    report = comparisons(older)[0]
    assert report.engine_version == 3
    own = math.hypot(report.standard_error or 0.0, report.input_error or 0.0)
    assert report.expected_error == pytest.approx(own)
    predict(older, FormulaRunner(older, 3))
    assert (comparisons(older)[0].expected_error or 0.0) > own


def test_refresh_gives_before_and_after_with_their_error_and_keeps_the_old_rows(older: Store) -> None:
    before = {report.mixture: report for report in comparisons(older)}
    runner = FormulaRunner(older, 3)
    found = refresh(older, runner, 3)
    assert [one.label for one in found[:3]] == [f"aggregate pebbles {name}" for name in "LMF"]
    after = {report.mixture: report for report in comparisons(older)}
    for one in found[3:]:
        then, now = before[one.name], after[one.name]
        assert (one.before, one.after) == (then.packing_density, now.packing_density)
        assert one.difference == (now.packing_density or 0.0) - (then.packing_density or 0.0) != 0.0
        assert one.standard_error == math.hypot(then.standard_error or 0.0, now.standard_error or 0.0)
    assert all(one.standard_error and one.standard_error > 0.0 for one in found)
    assert [report.state for report in after.values()] == ["done"] * 3
    with older.read() as session:
        for table in (Calibration, Prediction):
            versions = sorted(session.scalars(sa.select(table.engine_version)))
            assert versions == [2] * 3 + [3] * 3
    assert refresh(older, runner, 3) == []


def test_refresh_of_one_mixture_leaves_the_others(older: Store) -> None:
    found = refresh(older, FormulaRunner(older, 3), 3, ["pebbles L+M 1:1"])
    assert [one.label for one in found] == ["aggregate pebbles L", "aggregate pebbles M", "mixture pebbles L+M 1:1"]
    assert [report.engine_version for report in comparisons(older)] == [3, 2, 2]
    with pytest.raises(UnknownName, match="no mixture named 'gravel'"):
        refresh(older, FormulaRunner(older, 3), 3, ["gravel"])


def test_refresh_keeps_the_rule_and_names_what_cannot_be_worked_out_again(pebbles: Store) -> None:
    predict(pebbles, FormulaRunner(pebbles, 2), way=Way(rule="harmonic"))
    correct(pebbles, {"packing_test:1": {"voids_percent": "50"}}, "Anna")
    found = {one.label: one for one in refresh(pebbles, FormulaRunner(pebbles, 3), 3)}
    assert "is out of reach" in str(found["aggregate pebbles L"].error)
    assert found["mixture pebbles L+M 1:1"].error is not None
    assert found["mixture pebbles L+M 1:1"].difference is None
    assert found["mixture pebbles M+F 1:1"].error is None
    assert {report.rule for report in comparisons(pebbles) if report.state == "done"} == {"harmonic"}
