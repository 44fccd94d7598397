"""The method repose: the friction whose heap has a measured angle, the walls, the vibrated packing density."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import FormulaRunner, formula_angle, formula_density, formula_packing
from rich.console import Console

from pdlab import packing
from pdlab.angles import MeasuredAngle
from pdlab.calibration import ANGLE, NODES, Curve, CurvePoint, Ladder, beside, equal_beds, meet, packed, reach
from pdlab.cli.predicting import _show_calibrations
from pdlab.errors import AngleError, OutOfReach
from pdlab.experiments import (
    Way,
    calibrate,
    compare,
    comparisons,
    correct,
    predict,
    refresh,
    register,
    sheet,
    show,
)
from pdlab.experiments.readings import is_stale
from pdlab.models import Calibration, Run
from pdlab.specimen import REPOSE, VIBRATED, equal_spheres, on_grid, with_seeds
from pdlab.store import Store, calibrations
from pdlab.tables import read_path
from pdlab.tree import draw

AGGREGATES = """\
name,repose_angle_deg,wall_angle_deg
stone,20,25
pebbles,17,15
sand,18,
steep,35,
flat,4,
glass,,
"""
NAMES = ("stone", "pebbles", "sand", "steep", "flat", "glass")
PASSING = (100, 60, 20, 0), (100, 90, 40, 0)
SIEVES = "aggregate,aperture_mm,passing_percent\n" + "".join(
    f"{name},{2.0 ** (5 - k - j):g},{passing}\n"
    for k, name in enumerate(NAMES)
    for j, passing in enumerate(PASSING[k % 2])
)
MIXTURES = "mixture,aggregate,solid_volume_share\nM,stone,0.6\nM,pebbles,0.4\nN,sand,0.5\nN,pebbles,0.5\n"
REACHED = ["stone", "pebbles", "sand"]
BY_ANGLE = Way("repose")


@pytest.fixture
def lab(store: Store, folder: Any) -> Store:
    """A store of aggregates with angles of repose and without any density test."""
    register(store, read_path(folder(aggregates=AGGREGATES, sieves=SIEVES, mixtures=MIXTURES)))
    return store


def row_of(store: Store, name: str) -> Calibration:
    """The last calibration of an aggregate."""
    with store.read() as session:
        return next(fit for fit in calibrations(session) if fit.aggregate.name == name)


def specimens(store: Store, compaction: str) -> list[dict[str, Any]]:
    with store.read() as session:
        texts = [json.loads(run.specimen) for run in session.scalars(sa.select(Run))]
    return [one for one in texts if one["protocol"]["compaction"] == compaction]


def test_the_friction_found_is_that_whose_heap_has_the_measured_angle(lab: Store, formula_runner: Any) -> None:
    for report, angle in zip(calibrate(lab, formula_runner(lab), REACHED, BY_ANGLE), (20.0, 17.0, 18.0), strict=True):
        assert report.result is not None
        assert formula_angle(report.result.value) == pytest.approx(angle, abs=0.3)
        assert formula_angle(report.result.low) == pytest.approx(angle - 1.0, abs=0.3)
        assert formula_angle(report.result.high) == pytest.approx(angle + 1.0, abs=0.3)
        assert report.result.low < report.friction < report.result.high
        assert any("a standard error of 1 degree is assumed" in text for text in report.result.warnings)


def test_the_angle_of_a_smooth_law_rises_along_the_curve_and_noise_that_lowers_it_is_taken_out() -> None:
    points = [(0.0, 10.0), (0.1, 15.0), (0.2, 14.5), (0.5, 22.0), (1.0, 23.0)]
    curve = Curve(tuple(CurvePoint(mu, angle, 0.5, 4) for mu, angle in points), ANGLE)
    values = [curve.at(mu) for mu in np.linspace(0.0, 1.0, 200)]
    assert (np.diff(values) >= -1e-12).all()
    assert curve.monotone()[1] == curve.monotone()[2] == pytest.approx(14.75)
    assert curve.value_at(9.0) == 0.0
    assert curve.value_at(24.0) == 1.0
    assert curve.at(curve.value_at(19.0)) == pytest.approx(19.0)


def test_only_heaps_that_enclose_the_angle_are_run(lab: Store, formula_runner: Any) -> None:
    calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    heaps = specimens(lab, "repose")
    assert {one["species"][0]["friction"] for one in heaps} == {0.05, 0.1, 0.2}
    assert len(heaps) == 3 * 4


def test_the_slip_angle_s_tangent_is_the_friction_of_base_and_floor_and_without_one_the_protocol_s_rule_holds(
    lab: Store, formula_runner: Any
) -> None:
    (stone,) = calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    tangent = pytest.approx(math.tan(math.radians(25.0)), rel=1e-4)
    assert stone.wall == row_of(lab, "stone").wall_friction == tangent
    both = [*specimens(lab, "repose"), *specimens(lab, "vibrated")]
    assert [one["protocol"]["wall_friction"] for one in both] == [tangent] * len(both)
    (sand,) = calibrate(lab, formula_runner(lab), ["sand"], BY_ANGLE)
    assert sand.wall is None
    rest = [*specimens(lab, "repose"), *specimens(lab, "vibrated")]
    others = [one for one in rest if one["protocol"]["wall_friction"] != tangent]
    assert len(others) == 4 * 4 + 3 * 4
    assert all(one["protocol"]["wall_friction"] == one["species"][0]["friction"] for one in others)


def test_the_packing_density_is_the_mean_of_vibrated_beds_of_that_friction(lab: Store, formula_runner: Any) -> None:
    (report,) = calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    assert report.result is not None
    row, bed = row_of(lab, "stone"), equal_spheres(report.friction, 1, replace(VIBRATED, wall_friction=report.wall))
    values = [formula_packing(one).packing_density for one in with_seeds(bed, range(1, 5))]
    assert report.result.packing_density == row.packing_density == pytest.approx(np.mean(values))
    assert json.loads(row.protocol) == bed.protocol.settings()
    assert (row.packing_test_id, row.measured_packing_density, row.measured_angle_deg) == (None, None, 20.0)
    assert {one.digest(packing.VERSION) for one in with_seeds(bed, range(1, 5))} < {
        link.specimen_hash for link in row.runs
    }


def test_the_angle_s_error_becomes_one_in_packing_density_by_their_slope_and_the_curve_s_holds_the_seeds(
    lab: Store, formula_runner: Any
) -> None:
    (report,) = calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    found, step = report.result, 1e-3
    assert found is not None
    slope = (formula_density(found.value + step) - formula_density(found.value - step)) / (
        formula_angle(found.value + step) - formula_angle(found.value - step)
    )
    assert found.input_error == pytest.approx(abs(slope) * 1.0, rel=0.2)
    runs = [formula_packing(bed) for bed in equal_beds(report.friction, report.protocol)]
    seeds = float(np.std([one.packing_density for one in runs], ddof=1)) / 2.0
    assert seeds < found.curve_error < 0.5 * found.input_error


@pytest.mark.parametrize("deviation", [0.0, 0.4])
def test_the_curve_s_error_is_the_beds_scatter_and_the_angle_curve_s_own_by_the_same_slope(deviation: float) -> None:
    known = Curve(tuple(CurvePoint(mu, formula_angle(mu), deviation, 4) for mu in NODES), ANGLE)
    measured = MeasuredAngle(formula_angle(0.2), 1.0)
    met = meet(measured, known)
    assert met.value == 0.2
    beds = {
        mu: [formula_packing(bed) for bed in equal_beds(mu, VIBRATED)] for mu in (0.2, *beside(met, measured, known))
    }
    found = packed(met, measured, known, beds)
    seeds = float(np.std([bed.packing_density for bed in beds[0.2]], ddof=1)) / 2.0
    assert found.curve_error == pytest.approx(math.hypot(seeds, found.input_error * deviation / 2.0))


def test_the_reach_of_heaps_goes_from_the_flattest_to_the_steepest() -> None:
    ladder = Ladder("repose", ((1.0, 1.0),), REPOSE)
    nodes = {mu: [formula_packing(bed, 0.0) for bed in ladder.beds(mu)] for mu in (0.0, 1.0)}
    assert reach(nodes, ladder.sought) == pytest.approx((formula_angle(0.0), formula_angle(1.0)))
    assert reach({1.0: nodes[1.0]}, ladder.sought) == (None, pytest.approx(formula_angle(1.0)))


def test_errors_are_carried_on_one_side_where_the_angle_passes_the_curve_s_end() -> None:
    known = Curve(tuple(CurvePoint(mu, formula_angle(mu), 0.1, 4) for mu in NODES), ANGLE)
    measured = MeasuredAngle(formula_angle(1.0) + 1.5, 1.0)
    met = meet(measured, known)
    assert (met.value, met.high) == (1.0, None)
    assert "lies beyond the steepest heap" in met.warnings[0]
    low, high = beside(met, measured, known)
    assert high == 1.0
    assert formula_angle(low) == pytest.approx(formula_angle(1.0) - 1.0, abs=0.2)
    beds = {mu: [formula_packing(bed) for bed in equal_beds(mu, VIBRATED)] for mu in (met.value, low, high)}
    assert 0.0 < packed(met, measured, known, beds).input_error < 0.01


def test_an_angle_out_of_reach_names_the_angles_simulated_and_another_method(lab: Store, formula_runner: Any) -> None:
    runner = formula_runner(lab)
    (steep,), (flat,) = (calibrate(lab, runner, [name], BY_ANGLE) for name in ("steep", "flat"))
    assert isinstance(steep.error, OutOfReach)
    assert isinstance(flat.error, OutOfReach)
    assert str(steep.error) == (
        "angle of repose 35 degrees is out of reach of 'repose', which was simulated from 22.2 to 24.6 degrees: it is "
        "steeper than sliding friction makes a heap; check the angle, or calibrate to a density test, by the method "
        "'auto'"
    )
    assert "from 8.0 to " in str(flat.error)
    assert "flatter than frictionless spheres lie" in str(flat.error)
    assert (row_of(lab, "steep").state, specimens(lab, "vibrated")) == ("failed", [])


def test_an_aggregate_without_an_angle_or_with_one_that_is_none_is_refused_by_name(
    lab: Store, folder: Any, formula_runner: Any
) -> None:
    more = "name,repose_angle_deg,wall_angle_deg\nwrong,95,\nslippery,20,89\n"
    sieves = "aggregate,aperture_mm,passing_percent\nwrong,8,100\nwrong,4,0\nslippery,8,100\nslippery,4,0\n"
    register(lab, read_path(folder(aggregates=more, sieves=sieves)))
    reports = calibrate(lab, formula_runner(lab), ["glass", "wrong", "slippery"], BY_ANGLE)
    assert all(isinstance(report.error, AngleError) for report in reports)
    said = [str(report.error) for report in reports]
    assert said[0] == "aggregate 'glass' has no angle of repose; enter repose_angle_deg"
    assert "angle of repose of 95 degrees lies outside (0, 90)" in said[1]
    assert "slip angle of 89 degrees lies outside [0, 84]" in said[2]


def test_a_calibration_to_the_same_angle_is_read_and_an_aggregate_alike_needs_no_new_run(
    lab: Store, folder: Any, formula_runner: Any
) -> None:
    runner = formula_runner(lab)
    (first,) = calibrate(lab, runner, ["stone"], BY_ANGLE)
    asked = len(runner.asked)
    (again,) = calibrate(lab, runner, ["stone"], BY_ANGLE)
    assert (again.calibration_id, again.result) == (first.calibration_id, first.result)
    assert len(runner.asked) == asked
    twin = "name,repose_angle_deg,wall_angle_deg\ntwin,20,25\n"
    register(lab, read_path(folder(aggregates=twin, sieves=SIEVES.replace("stone,", "twin,").split("pebbles")[0])))
    (other,) = calibrate(lab, runner, ["twin"], BY_ANGLE)
    assert other.friction == first.friction
    assert set(runner.asked[asked:]) <= set(runner.asked[:asked])


def test_a_new_density_test_leaves_a_calibration_to_an_angle_and_stands_beside_it_where_it_was_vibrated(
    lab: Store, folder: Any, formula_runner: Any
) -> None:
    runner = formula_runner(lab)
    predict(lab, runner, ["M"], BY_ANGLE)
    tests = "material,compaction,packing_density\nstone,vibrated,0.63\npebbles,loose,0.6\n"
    register(lab, read_path(folder(packing_tests=tests)))
    assert not any(is_stale(row_of(lab, name)) for name in ("stone", "pebbles"))
    assert outdated(lab) == []
    assert {one.state for one in comparisons(lab) if one.mixture == "M"} == {"done"}
    stone, pebbles = calibrate(lab, runner, ["stone", "pebbles"], BY_ANGLE)
    assert stone.measured == 0.63
    assert np.isnan(pebbles.measured)


def outdated(store: Store) -> list[str]:
    """The aggregates whose calibrations are outdated, by the view."""
    with store.read() as session:
        return list(session.scalars(sa.text("SELECT DISTINCT aggregate FROM outdated_calibrations ORDER BY aggregate")))


@pytest.mark.parametrize(
    ("column", "value"), [("repose_angle_deg", 20.5), ("wall_angle_deg", 24.0), ("repose_angle_deg", None)]
)
def test_a_corrected_angle_outdates_a_calibration_and_what_rests_on_it(
    lab: Store, formula_runner: Any, column: str, value: float | None
) -> None:
    predict(lab, formula_runner(lab), ["M"], BY_ANGLE)
    correct(lab, {"aggregate:stone": {column: "" if value is None else str(value)}}, "me")
    assert is_stale(row_of(lab, "stone"))
    assert not is_stale(row_of(lab, "pebbles"))
    assert outdated(lab) == ["stone"]
    (report,) = (one for one in comparisons(lab) if one.mixture == "M")
    assert report.state == "outdated"


def test_a_new_sieve_analysis_outdates_a_calibration_to_an_angle(lab: Store, folder: Any, formula_runner: Any) -> None:
    calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    register(lab, read_path(folder(sieves="aggregate,aperture_mm,passing_percent\nstone,64,100\nstone,32,0\n")))
    assert is_stale(row_of(lab, "stone"))
    assert outdated(lab) == ["stone"]


def test_a_mixture_is_vibrated_with_both_frictions_and_the_smaller_of_the_walls(
    lab: Store, folder: Any, formula_runner: Any
) -> None:
    register(lab, read_path(folder(packing_tests="material,compaction,packing_density\nM,loose,0.66\n")))
    one, other = predict(lab, formula_runner(lab), ["M", "N"], BY_ANGLE)
    assert (one.method, one.state, other.state) == ("repose", "done", "done")
    assert (
        one.tested_otherwise == "the mixture's density test is loose, its beds are vibrated: the difference is of both"
    )
    assert not other.tested_otherwise
    frictions = {name: row_of(lab, name).friction for name in REACHED}
    beds = [bed for bed in specimens(lab, "vibrated") if len(bed["species"]) == 2]
    walls = {tuple(kind["friction"] for kind in bed["species"]): bed["protocol"]["wall_friction"] for bed in beds}
    slip = on_grid(math.tan(math.radians(15.0)))
    assert walls == {
        (frictions["stone"], frictions["pebbles"]): slip,
        (frictions["pebbles"], frictions["sand"]): slip,
    }


def test_a_mixture_s_input_error_is_carried_from_the_vibrated_packing_densities(
    lab: Store, formula_runner: Any
) -> None:
    (report,) = predict(lab, formula_runner(lab), ["M"], BY_ANGLE)
    parts = [(share, row_of(lab, name)) for share, name in ((0.6, "stone"), (0.4, "pebbles"))]
    assert report.packing_density is not None
    carried = [
        share * (report.packing_density / float(fit.packing_density or 0)) ** 2 * float(fit.input_error or 0)
        for share, fit in parts
    ]
    assert report.input_error == pytest.approx(math.hypot(*carried))


def test_compare_holds_only_vibrated_measurements_against_the_method(
    lab: Store, folder: Any, formula_runner: Any
) -> None:
    tests = "material,compaction,packing_density\nM,loose,0.66\nN,vibrated,0.65\n"
    register(lab, read_path(folder(packing_tests=tests)))
    predict(lab, formula_runner(lab), ["M", "N"], BY_ANGLE)
    outcomes = compare(lab).outcomes["repose"]
    assert isinstance(outcomes["N"], float)
    assert outcomes["M"] == "'repose' is vibrated and the mixture is not; test it vibrated"


def test_the_sheet_works_by_angle_and_the_diameter_rules_need_no_further_heap(lab: Store, formula_runner: Any) -> None:
    predict(lab, formula_runner(lab), ["M"], BY_ANGLE)
    heaps = specimens(lab, "repose")
    (one,) = sheet(lab, formula_runner(lab), ["M"], BY_ANGLE)
    assert [str(other.report.error) for other in one.assumed if other.report.error is not None] == []
    further = [heap for heap in specimens(lab, "repose") if heap not in heaps]
    assert {heap["protocol"]["local_damping"] for heap in further} == {0.0}
    assert (one.spread("diameter rule") or 0.0) > 0.0


def test_auto_asks_for_density_tests_and_never_takes_the_angle(lab: Store, formula_runner: Any) -> None:
    (report,) = calibrate(lab, formula_runner(lab), ["stone"], Way("auto"))
    assert str(report.error) == "aggregate 'stone' has no density test; enter one"


def test_refresh_calibrates_and_predicts_by_the_angle_again(lab: Store, formula_runner: Any) -> None:
    predict(lab, FormulaRunner(lab, packing.VERSION - 1), ["M"], BY_ANGLE)
    found = refresh(lab, formula_runner(lab), packing.VERSION)
    assert [one.label for one in found] == ["aggregate stone", "aggregate pebbles", "mixture M"]
    assert all(one.error is None and one.after is not None for one in found)


def test_the_report_prints_angle_friction_wall_and_both_packing_densities(
    lab: Store, folder: Any, formula_runner: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    register(lab, read_path(folder(packing_tests="material,compaction,packing_density\nstone,vibrated,0.63\n")))
    _show_calibrations(calibrate(lab, formula_runner(lab), ["stone", "sand"], BY_ANGLE))
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    fit = row_of(lab, "stone")
    stone = next(line for line in lines if line[:1] == ["stone"])
    assert stone[2:5] == ["20", "0.466", f"{fit.friction:.4g}"]
    assert stone[-4:] == [
        f"{fit.packing_density:.4f}", f"{fit.input_error:.4f}", f"{fit.curve_error:.4f}", "0.6300"
    ]  # fmt: skip
    assert next(line for line in lines if line[:1] == ["sand"])[2] == "18"


def test_a_calibration_to_an_angle_and_its_heaps_are_drawn_with_their_angles(lab: Store, formula_runner: Any) -> None:
    calibrate(lab, formula_runner(lab), ["stone"], BY_ANGLE)
    console = Console(width=400)
    with console.capture() as out:
        console.print(draw(show(lab, "calibration:1")))
    assert "measured angle of repose 20°" in out.get()
    assert f"angle of repose {formula_angle(0.2):.0f}" in out.get()
