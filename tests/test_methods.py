"""The methods over one interface: what each makes of an aggregate, what auto takes, the assumption sheet."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from pdlab import experiments
from pdlab.errors import InputError, OutOfReach, SpecimenTooLarge, TableError
from pdlab.experiments import CHOICES, Way, calibrate, comparisons, predict, register, sheet
from pdlab.models import Calibration, Prediction, Run, now
from pdlab.store import Store
from pdlab.tables import read_path

Folder = Callable[..., Path]
AGGREGATES = "name\nround\nstone\nsand\n"
SIEVES = """\
aggregate,aperture_mm,passing_percent
round,16,100
round,8,0
stone,8,100
stone,4,0
sand,4,100
sand,2,60
sand,1,0
"""
TESTS = "material,compaction,packing_density\nround,loose,0.59\nstone,loose,0.5\nsand,loose,0.66\n"
MIXTURES = "mixture,aggregate,solid_volume_share\nM,round,0.4\nM,stone,0.3\nM,sand,0.3\nR,round,0.6\nR,stone,0.4\n"


@pytest.fixture
def lab(store: Store, folder: Folder) -> Store:
    """A store of round pebbles, crushed stone and graded sand: in, below and above the reach of sliding friction."""
    register(store, read_path(folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=TESTS, mixtures=MIXTURES)))
    return store


def rows(store: Store, table: Any) -> list[Any]:
    with store.read() as session:
        return list(session.scalars(select(table)))


def test_a_calibration_asked_for_again_is_the_one_that_is_kept_though_the_curve_has_grown(
    lab: Store, formula_runner: Any
) -> None:
    runner = formula_runner(lab)
    (first,) = calibrate(lab, runner, ["round"])
    calibrate(lab, runner, ["round", "stone", "sand"], Way("auto"))  # carries the curve on to both ends
    asked = len(runner.asked)
    (again,) = calibrate(lab, runner, ["round"])
    assert (again.calibration_id, again.result) == (first.calibration_id, first.result)
    assert len(runner.asked) == asked


def test_a_further_aggregate_inside_the_curve_needs_no_new_run(lab: Store, folder: Folder, formula_runner: Any) -> None:
    runner = formula_runner(lab)
    calibrate(lab, runner, ["round", "stone", "sand"], Way("auto"))
    asked = len(runner.asked)
    more = "name\nother\n", "aggregate,aperture_mm,passing_percent\nother,63,100\nother,31.5,0\n"
    tests = "material,compaction,packing_density\nother,loose,0.615\n"
    register(lab, read_path(folder(aggregates=more[0], sieves=more[1], packing_tests=tests)))
    (report,) = calibrate(lab, runner, ["other"])
    assert report.result is not None
    assert len(runner.asked) == asked


def test_more_seeds_than_usual_are_a_wish_for_a_new_calibration(lab: Store, formula_runner: Any) -> None:
    runner = formula_runner(lab)
    (first,) = calibrate(lab, runner, ["round"])
    (finer,) = calibrate(lab, runner, ["round"], Way(seeds=8))
    assert finer.calibration_id != first.calibration_id
    assert first.result is not None
    assert finer.result is not None
    assert finer.result.curve_error < first.result.curve_error


def test_auto_takes_the_first_method_that_reaches_each_aggregate_and_says_why(lab: Store, formula_runner: Any) -> None:
    reports = {
        one.aggregate: one for one in calibrate(lab, formula_runner(lab), ["round", "stone", "sand"], Way("auto"))
    }
    assert {name: one.method for name, one in reports.items()} == {
        "round": "monosized", "stone": "monosized_rolling", "sand": "graded",
    }  # fmt: skip
    assert reports["round"].choice == ""
    assert "0.5 is out of reach of 'monosized'" in reports["stone"].choice
    assert reports["stone"].friction == 1.0
    assert reports["stone"].rolling > 0.0
    assert [round(size, 3) for size, _ in reports["sand"].sizes] == [2.828, 1.414]


def test_one_mixture_may_hold_all_three_methods_and_keeps_what_was_taken(lab: Store, formula_runner: Any) -> None:
    (report,) = predict(lab, formula_runner(lab), ["M"], Way("auto"))
    assert (report.method, report.state) == ("auto", "done")
    assert "stone: 'monosized_rolling' is taken" in report.message
    assert "sand: 'graded' is taken" in report.message
    (row,) = rows(lab, Prediction)
    beds = {run.specimen_hash: json.loads(run.specimen) for run in rows(lab, Run)}
    with lab.read() as session:
        row = session.get(Prediction, row.id)
        species = beds[row.runs[0].specimen_hash]["species"]
        assert sorted(link.calibration.method for link in row.calibrations) == [
            "graded",
            "monosized",
            "monosized_rolling",
        ]
    assert len(species) == 4
    assert [kind["rolling"] > 0.0 for kind in species] == [False, True, False, False]


def test_predictions_by_several_methods_stand_side_by_side(lab: Store, formula_runner: Any) -> None:
    for method in ("monosized_rolling", "auto"):
        predict(lab, formula_runner(lab), ["R"], Way(method))
    found = [report for report in comparisons(lab) if report.mixture == "R"]
    assert [(report.method, report.state) for report in found] == [("monosized_rolling", "failed"), ("auto", "done")]


def test_the_interval_of_rolling_friction_is_kept_as_such(lab: Store, formula_runner: Any) -> None:
    (report,) = calibrate(lab, formula_runner(lab), ["stone"], Way("monosized_rolling"))
    (row,) = rows(lab, Calibration)
    assert report.result is not None
    assert (row.friction, row.friction_low, row.friction_high) == (1.0, None, None)
    assert row.rolling_friction_low == report.result.low < row.rolling_friction < row.rolling_friction_high


def test_out_of_reach_names_the_interval_of_every_method_and_those_that_reach(lab: Store, formula_runner: Any) -> None:
    stone, sand = calibrate(lab, formula_runner(lab), ["stone", "sand"])
    assert isinstance(stone.error, OutOfReach)
    assert "'monosized' spans 0.55" in str(stone.error)
    assert "'monosized_rolling' spans 0.45" in str(stone.error)
    assert str(stone.error).endswith("use the method 'monosized_rolling', or 'auto'")
    assert str(sand.error).endswith("use the method 'graded', or 'auto'")


def test_auto_that_reaches_nothing_names_every_interval(lab: Store, folder: Folder, formula_runner: Any) -> None:
    tests = "material,compaction,packing_density,date\nround,loose,0.75,2026-01-02\nstone,loose,0.3,2026-01-02\n"
    register(lab, read_path(folder(packing_tests=tests + "sand,loose,0.9,2026-01-02\n")))
    dense, loose, graded = calibrate(lab, formula_runner(lab), ["round", "stone", "sand"], Way("auto"))
    assert "'graded'" in str(dense.error)
    assert "no bed of these spheres is so dense" in str(dense.error)
    assert "no method of spheres is so loose" in str(loose.error)
    assert "'graded' spans" in str(graded.error)


def test_fines_are_left_out_only_where_that_is_asked_for_and_the_result_names_them(
    lab: Store, formula_runner: Any
) -> None:
    whole = calibrate(lab, formula_runner(lab), ["sand"], Way("graded"))[0]
    cut = calibrate(lab, formula_runner(lab), ["sand"], Way("graded", leave_out=2.0))[0]
    assert [len(report.sizes) for report in (whole, cut)] == [2, 1]
    assert whole.result is not None
    assert not any("left out" in text for text in whole.result.warnings)
    assert isinstance(cut.error, OutOfReach)
    row = next(row for row in rows(lab, Calibration) if row.leave_out_below_mm)
    assert json.loads(row.spheres) == [[pytest.approx(8.0**0.5), 1.0]]


def test_what_was_left_out_stands_with_the_result(lab: Store, folder: Folder, formula_runner: Any) -> None:
    tests = "material,compaction,packing_density,date\nsand,loose,0.6,2026-01-02\n"
    register(lab, read_path(folder(packing_tests=tests)))
    cut = calibrate(lab, formula_runner(lab), ["sand"], Way("graded", leave_out=2.0))[0]
    assert cut.result is not None
    assert "60 % of the solids, finer than 2 mm, are left out" in cut.result.warnings
    (other,) = calibrate(lab, formula_runner(lab), ["sand"], Way("auto", leave_out=2.0))
    assert other.result is not None
    assert other.method == "monosized"
    assert not any("left out" in text for text in other.result.warnings)


def test_graded_spheres_beyond_the_cap_say_how_many_and_what_to_leave_out(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    sieves = "aggregate,aperture_mm,passing_percent\nwide,64,100\nwide,32,60\nwide,8,30\nwide,1,20\nwide,0.5,0\n"
    tests = "material,compaction,packing_density\nwide,loose,0.66\n"
    register(lab, read_path(folder(aggregates="name\nwide\n", sieves=sieves, packing_tests=tests)))
    (report,) = calibrate(lab, formula_runner(lab), ["wide"], Way("graded"))
    assert isinstance(report.error, SpecimenTooLarge)
    assert "leave out what is finer than 2.83 mm, 20 % of the solids (--leave-out 2.83)" in str(report.error)
    (cut,) = calibrate(lab, formula_runner(lab), ["wide"], Way("graded", leave_out=2.8))
    assert not isinstance(cut.error, SpecimenTooLarge)


def test_a_rule_seeds_or_sizes_that_make_no_sense_are_refused() -> None:
    one_size = {"method": "monosized", "leave_out": 2.0}
    for wrong in (
        {"method": "magic"},
        {"rule": "median"},
        {"seeds": 1},
        {"method": "graded", "leave_out": 0.0},
        one_size,
    ):
        with pytest.raises(InputError):
            Way(**wrong)  # type: ignore[arg-type]


def test_the_sheet_works_the_whole_chain_out_under_every_other_choice(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    tests = "material,compaction,packing_density,date\nsand,loose,0.6,2026-01-02\n"  # in reach of equal spheres
    register(lab, read_path(folder(packing_tests=tests)))
    (one,) = sheet(lab, formula_runner(lab), ["M"], Way("auto"))
    assert [other.name for other in one.assumed if other.choice == "pair friction"] == ["mean", "geometric_mean"]
    assert len(one.assumed) == 8
    assert one.spread("diameter rule") is not None
    values = [other.report.packing_density for other in one.assumed if other.choice == "diameter rule"]
    known = [value for value in [one.report.packing_density, *values] if value is not None]
    assert one.spread("diameter rule") == max(known) - min(known) > 0.0
    assert {choice for choice in CHOICES if one.spread(choice) is not None} == {*CHOICES} - {"assumed pan size"}
    variants = {row.variant for row in rows(lab, Prediction)}
    assert {"", "local_damping=0", "pair_friction=mean", "diameter_rule=harmonic"} <= variants


def test_the_sheet_halves_and_doubles_the_size_assumed_of_a_pan(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    sieves = "aggregate,aperture_mm,passing_percent\nwith pan,4,100\nwith pan,2,50\nwith pan,1,8\n"
    tests = "material,compaction,packing_density\nwith pan,loose,0.6\n"
    mixtures = "mixture,aggregate,solid_volume_share\nP,round,0.5\nP,with pan,0.5\n"
    register(
        lab, read_path(folder(aggregates="name\nwith pan\n", sieves=sieves, packing_tests=tests, mixtures=mixtures))
    )
    (one,) = sheet(lab, formula_runner(lab), ["P"])
    made = {other.name: other.report for other in one.assumed if other.choice == "assumed pan size"}
    assert made.keys() == {"0.5 times", "2 times"}
    diameters = {row.variant: row.diameter_mm for row in rows(lab, Calibration) if row.aggregate_id == 4}
    assert diameters["assumed_pan_size=0.5"] == pytest.approx(diameters[""] * 2.0**-0.04)
    assert diameters["assumed_pan_size=2"] == pytest.approx(diameters[""] * 2.0**0.04)


def test_variants_are_in_no_list_and_no_current_calibration(lab: Store, formula_runner: Any) -> None:
    sheet(lab, formula_runner(lab), ["R"], Way("auto"))
    found = [report for report in comparisons(lab) if report.mixture == "R"]
    assert [(report.method, report.rule) for report in found] == [("auto", "log_mean")]
    undamped = [row for row in rows(lab, Calibration) if json.loads(row.protocol)["local_damping"] == 0.0]
    assert {row.variant for row in undamped} == {"local_damping=0"}
    with lab.write() as session:  # asked for last, and of the same tests
        fit = session.scalars(select(Calibration).where(Calibration.variant == "diameter_rule=harmonic")).first()
        assert fit is not None
        fit.requested_at, fit.friction = now(), 0.9
    summary = {one.name: one for one in experiments.summaries(lab)}
    assert (summary["stone"].method, summary["stone"].friction) == ("monosized_rolling", 1.0)
    assert (summary["stone"].rolling or 0.0) > 0.0
    usual = {one.aggregate: one for one in calibrate(lab, formula_runner(lab), ["round"])}
    assert usual["round"].result is not None
    assert summary["round"].friction == usual["round"].result.value


def test_aggregates_of_one_sieve_class_owe_nothing_to_four_of_the_rules(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)
    predict(pebbles, runner)
    runs = {run.specimen_hash for run in rows(pebbles, Run)}
    for rule in ("harmonic", "arithmetic", "number_volume"):
        predict(pebbles, runner, (), Way(rule=rule))
    assert {run.specimen_hash for run in rows(pebbles, Run)} == runs


def test_two_current_tests_that_disagree_are_a_warning_that_is_kept(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    (before,) = calibrate(lab, formula_runner(lab), ["round"])
    assert before.result is not None
    assert not any("disagree" in text for text in before.result.warnings)
    tests = "material,compaction,packing_density,date\nround,loose,0.62,2026-01-02\n"
    register(lab, read_path(folder(packing_tests=tests)))
    (after,) = calibrate(lab, formula_runner(lab), ["round"])
    assert after.result is not None
    assert any("disagree by 0.0300 in PD (0.5900, then 0.6200)" in text for text in after.result.warnings)


@pytest.mark.parametrize(("share", "warned"), [(4, False), (8, True)])
def test_more_than_five_percent_of_cohesive_fines_are_a_warning_that_is_kept(
    store: Store, folder: Folder, formula_runner: Any, share: int, warned: bool
) -> None:
    sieves = f"aggregate,aperture_mm,passing_percent\nfine,0.5,100\nfine,0.125,{share}\nfine,0.063,0\n"
    tests = "material,compaction,packing_density\nfine,loose,0.6\n"
    register(store, read_path(folder(aggregates="name\nfine\n", sieves=sieves, packing_tests=tests)))
    (report,) = calibrate(store, formula_runner(store), ["fine"])
    assert report.result is not None
    assert any("cohesion" in text for text in report.result.warnings) == warned


@pytest.mark.parametrize(("moisture", "warned"), [("", False), ("1,5", False), ("4 %", True)])
def test_a_test_of_material_wetter_than_it_absorbs_is_a_warning_that_is_kept(
    store: Store, folder: Folder, formula_runner: Any, moisture: str, warned: bool
) -> None:
    aggregates = "name;water_absorption_percent\nA;1,5\n"
    sieves = "aggregate,aperture_mm,passing_percent\nA,8,100\nA,4,0\n"
    tests = f"material;compaction;packing_density;moisture_percent\nA;loose;0,6;{moisture}\n"
    register(store, read_path(folder(aggregates=aggregates, sieves=sieves, packing_tests=tests)))
    (report,) = calibrate(store, formula_runner(store), ["A"])
    assert report.result is not None
    assert any("bulking" in text for text in report.result.warnings) == warned


def test_a_moisture_that_cannot_be_one_is_refused(store: Store, folder: Folder) -> None:
    tests = "material,compaction,packing_density,moisture_percent\nA,loose,0.6,-1\n"
    with pytest.raises(TableError, match="moisture_percent"):
        register(store, read_path(folder(aggregates="name\nA\n", packing_tests=tests)))


def test_lists_show_the_rolling_friction_of_what_was_calibrated_to_it(lab: Store, formula_runner: Any) -> None:
    (report,) = calibrate(lab, formula_runner(lab), ["stone"], Way("auto"))
    columns = ["method", "friction", "rolling_friction", "rolling_friction_low", "rolling_friction_high"]
    _, listed = experiments.listed(lab, "aggregates", ["aggregate=stone"], columns)
    assert report.result is not None
    result = report.result
    assert [*listed[0]] == ["monosized_rolling", 1.0, result.value, result.low, result.high]
