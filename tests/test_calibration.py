"""The curve PD(μ), the nodes it asks for, the friction it gives."""

import itertools
import math

import numpy as np
import pytest
from conftest import formula_density, formula_packing

from pdlab import calibration
from pdlab.calibration import NODES, SEEDS, Curve, CurvePoint, Ladder
from pdlab.density import MeasuredPacking
from pdlab.errors import OutOfReach
from pdlab.specimen import Packing

LADDER = Ladder("monosized", ((1.0, 1.0),))


def fill(
    nodes: dict[float, list[Packing]], value: float, error: float = 0.005, noise: float = 0.0, seeds: int = SEEDS
) -> int:
    """Run what the search asks for into the nodes, with an engine that answers by a formula; return the new runs."""
    new = 0
    for _ in range(20):
        wanted = calibration.missing_nodes(MeasuredPacking(value, error), calibration.curve(nodes), seeds)
        if not wanted:
            return new
        for node, count in wanted.items():
            assert len(nodes.get(node, [])) < count
            new += count - len(nodes.get(node, []))
            nodes[node] = [formula_packing(bed, noise) for bed in LADDER.beds(node, count)]
    raise AssertionError("the search does not end")


def calibrate(value: float, error: float = 0.005, noise: float = 0.0) -> tuple[calibration.Calibrated, set[float]]:
    """Calibrate from no runs at all."""
    nodes: dict[float, list[Packing]] = {}
    fill(nodes, value, error, noise)
    known = calibration.curve(nodes)
    assert known is not None
    return calibration.solve(MeasuredPacking(value, error), known), set(nodes)


@pytest.mark.parametrize("friction", [0.01, 0.03, 0.08, 0.2, 0.27, 0.4, 0.8])
def test_a_known_law_gives_its_friction_back(friction: float) -> None:
    value = formula_density(friction)
    found, _ = calibrate(value, 0.002)
    assert formula_density(found.value) == pytest.approx(value, abs=0.001)
    assert found.packing_density == pytest.approx(value, abs=1e-4)


def test_the_interval_is_where_the_curve_meets_the_measured_plus_and_minus_its_error() -> None:
    found, _ = calibrate(0.585, 0.005)
    assert found.low is not None
    assert found.high is not None
    assert found.low < found.value < found.high
    assert formula_density(found.low) == pytest.approx(0.590, abs=0.001)
    assert formula_density(found.high) == pytest.approx(0.580, abs=0.001)


def test_an_interval_that_passes_the_end_is_open() -> None:
    loose, _ = calibrate(formula_density(1.0) + 0.002)
    dense, _ = calibrate(formula_density(0.0) - 0.002)
    assert loose.high is None
    assert loose.low is not None
    assert dense.low is None
    assert dense.high is not None


@pytest.mark.parametrize(
    ("value", "span"), [(0.47, "which was simulated from 0.554"), (0.66, "which was simulated from 0.574 to 0.640")]
)
def test_a_density_out_of_reach_is_refused_with_the_interval_and_a_side(value: float, span: str) -> None:
    with pytest.raises(OutOfReach, match=rf"density {value} is out of reach of 'monosized', {span}") as said:
        calibrate(value)
    assert said.value.looser == (value < 0.5)


def test_a_density_just_beyond_the_end_takes_the_end_with_a_warning() -> None:
    found, _ = calibrate(formula_density(1.0) - 0.006, 0.005, noise=0.001)
    assert found.value == 1.0
    assert "beyond the loosest bed" in found.warnings[0]


def test_only_nodes_that_enclose_the_density_are_run() -> None:
    _, nodes = calibrate(0.577, 0.002)
    assert nodes <= set(NODES)
    assert len(nodes) <= 3


def test_noise_that_makes_the_curve_rise_is_taken_out_and_never_splits_the_answer() -> None:
    points = [(0.0, 0.64), (0.1, 0.60), (0.2, 0.602), (0.5, 0.56), (1.0, 0.55)]
    curve = Curve(tuple(CurvePoint(mu, pd, 0.003, 4) for mu, pd in points))
    assert (np.diff(curve.monotone()) <= 0.0).all()
    values = [curve.at(mu) for mu in np.linspace(0.0, 1.0, 200)]
    assert (np.diff(values) <= 1e-12).all()
    assert 0.1 <= curve.value_at(0.601) <= 0.2


def test_the_curve_error_is_the_pooled_deviation_over_the_root_of_the_seeds() -> None:
    curve = Curve((CurvePoint(0.1, 0.60, 0.002, 4), CurvePoint(0.2, 0.59, 0.004, 4)))
    pooled = math.sqrt((0.002**2 + 0.004**2) / 2.0)
    assert curve.error_at(0.1) == pytest.approx(pooled / 2.0)
    assert curve.error_at(0.15) < curve.error_at(0.1)


def test_the_curve_error_holds_what_the_interpolation_may_be_off() -> None:
    bent = [CurvePoint(mu, pd, 0.0, 4) for mu, pd in ((0.0, 0.64), (0.25, 0.60), (1.0, 0.59))]
    straight = [CurvePoint(mu, pd, 0.0, 4) for mu, pd in ((0.0, 0.64), (0.25, 0.62), (1.0, 0.60))]
    assert Curve(tuple(bent)).error_at(0.1) > 1e-4
    assert Curve(tuple(straight)).error_at(0.1) == pytest.approx(0.0, abs=1e-12)


def test_a_filled_curve_needs_no_new_run_whatever_the_density() -> None:
    nodes = {node: [formula_packing(bed) for bed in LADDER.beds(node)] for node in NODES}
    for value in np.linspace(0.556, 0.636, 41):
        assert fill(nodes, float(value)) == 0


def test_inside_a_curve_no_run_is_new_whatever_was_calibrated_before() -> None:
    for first, second in itertools.permutations(np.linspace(0.556, 0.636, 9), 2):
        nodes: dict[float, list[Packing]] = {}
        fill(nodes, float(first))
        fill(nodes, float(second))
        for between in np.linspace(min(first, second), max(first, second), 7):
            assert fill(nodes, float(between)) == 0


def test_a_node_that_stands_apart_is_no_part_of_the_curve_and_yet_tells_the_reach() -> None:
    nodes = {node: [formula_packing(bed) for bed in LADDER.beds(node)] for node in (0.1, 0.2, 0.3, 1.0)}
    known = calibration.curve(nodes)
    assert known is not None
    assert [point.value for point in known.points] == [0.1, 0.2, 0.3]
    assert calibration.reach(nodes) == (pytest.approx(formula_density(1.0), abs=0.001), None)
    assert calibration.curve({1.0: nodes[1.0]}) is None


def test_more_seeds_than_usual_are_run_around_the_answer_also_of_a_filled_curve() -> None:
    nodes = {node: [formula_packing(bed) for bed in LADDER.beds(node)] for node in NODES}
    assert fill(nodes, 0.5805, seeds=6) == 4
    assert sorted(len(packings) for packings in nodes.values())[-3:] == [4, 6, 6]


@pytest.mark.parametrize(("standard_errors", "refused"), [(1.8, False), (2.3, True)])
def test_the_end_of_the_curve_reaches_two_standard_errors(standard_errors: float, refused: bool) -> None:
    value = formula_density(1.0) - standard_errors * 0.005
    if refused:
        with pytest.raises(OutOfReach):
            calibrate(value, 0.005)
    else:
        assert calibrate(value, 0.005)[0].value == 1.0
