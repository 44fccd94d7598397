"""Errors of a method with their intervals, and leave-one-out for what is fitted."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import bootstrap

from pdlab.comparison import (
    MANY,
    LeftOut,
    best_constant,
    errors_of,
    fitted_to_the_others,
    gain_over,
    mean_with_interval,
)
from pdlab.errors import InputError, OutOfReach, TooFewData
from pdlab.theory import Material, cpm, fit_compaction_index

COARSE, MIDDLE, FINE = Material(20.0, 0.6), Material(6.0, 0.58), Material(1.0, 0.62, (1.4, 0.7), (0.5, 0.5))
THREE = [COARSE, MIDDLE, FINE]
SHARES = np.array([[0.7, 0.3, 0.0], [0.6, 0.0, 0.4], [0.0, 0.5, 0.5], [0.4, 0.3, 0.3], [0.8, 0.1, 0.1]])
MEASURED = cpm(THREE, SHARES, 6.0) + np.array([0.004, -0.006, 0.005, 0.002, -0.003])


def test_the_errors_are_those_worked_out_by_hand() -> None:
    found = errors_of([0.01, -0.03, 0.02])
    assert found.mixtures == 3
    assert found.bias.value == pytest.approx(0.0, abs=1e-15)
    assert found.mean_absolute.value == pytest.approx(0.02)
    assert found.root_mean_square.value == pytest.approx(math.sqrt(14e-4 / 3))
    assert (found.largest, found.where) == (-0.03, 1)


def test_an_interval_holds_the_figure_and_widens_with_its_confidence() -> None:
    off = np.random.default_rng(3).normal(0.01, 0.02, 12)
    narrow, wide = errors_of(off, 0.5), errors_of(off, 0.99)
    for name in ("bias", "mean_absolute", "root_mean_square"):
        inner, outer = getattr(narrow, name), getattr(wide, name)
        assert outer.low < inner.low < inner.value == outer.value < inner.high < outer.high


def test_the_intervals_of_many_mixtures_hold_the_truth_as_often_as_they_say() -> None:
    draw, held = np.random.default_rng(5), {"bias": 0, "mean_absolute": 0, "root_mean_square": 0}
    bias, scatter = 0.01, 0.02
    mean_absolute = float(np.abs(draw.normal(bias, scatter, 10**6)).mean())
    truth = {"bias": bias, "mean_absolute": mean_absolute, "root_mean_square": math.hypot(bias, scatter)}
    for _ in range(150):
        found = errors_of(draw.normal(bias, scatter, 50), 0.9)
        for name, value in truth.items():
            held[name] += getattr(found, name).low <= value <= getattr(found, name).high
    for name, count in held.items():
        assert 0.8 < count / 150 < 0.97, name  # 0.9 but for three standard errors of 150 draws, and 50 mixtures


def drawn(values: np.ndarray, seed: int = 1) -> np.ndarray:
    found = bootstrap((values,), np.mean, n_resamples=9999, method="percentile", rng=np.random.default_rng(seed))
    return np.array(found.confidence_interval)


@pytest.mark.parametrize("power", [1, 2], ids=["differences", "squares"])
@pytest.mark.parametrize("count", [MANY, 3 * MANY])
def test_intervals_of_many_mixtures_are_those_of_resamples_to_what_seeds_differ(count: int, power: int) -> None:
    for seed in range(3):
        values = np.random.default_rng(seed).standard_t(4, count) ** power
        error = values.std() / math.sqrt(count)
        found = mean_with_interval(values)
        assert np.abs(np.array([found.low, found.high]) - drawn(values)).max() < 0.1 * error  # 3 to 4 deviations


def test_where_one_mixture_outweighs_the_others_or_there_are_few_the_interval_is_drawn() -> None:
    for count in (MANY - 1, 3 * MANY):
        values = np.random.default_rng(2).normal(0.0, 0.01, count) ** 2
        values[::count] = 0.1**2
        found = mean_with_interval(values)
        assert [found.low, found.high] == drawn(values).tolist()
        assert errors_of(np.sqrt(values), 0.999).root_mean_square.low is not None


def test_an_interval_is_that_of_its_seed() -> None:
    off = np.random.default_rng(3).normal(0.01, 0.02, 12)
    assert errors_of(off, seed=1) == errors_of(off, seed=1)
    assert errors_of(off, seed=1).bias.low != errors_of(off, seed=2).bias.low


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_mixtures_have_figures_and_no_interval(count: int) -> None:
    found = errors_of([0.01, -0.03][:count])
    for figure in (found.bias, found.mean_absolute, found.root_mean_square):
        assert (figure.low, figure.high) == (None, None)
        said = ("1 mixture says", "2 mixtures say")[count - 1]
        assert figure.no_interval.startswith(f"{said} nothing of an interval, it takes 3")
    assert found.mean_absolute.value == pytest.approx((0.01, 0.02)[count - 1])


def test_equal_values_have_no_interval_also_where_they_differ_by_rounding() -> None:
    found = errors_of([0.02, -0.02, 0.02 + 1e-17])
    assert found.bias.low is not None
    for figure in (found.mean_absolute, found.root_mean_square):
        assert figure.low is None
        assert figure.no_interval == "all 3 mixtures give the same value"
    assert mean_with_interval([0.0] * 4).no_interval == "all 4 mixtures give the same value"


def test_a_method_that_is_always_better_by_the_same_has_a_sure_gain_however_both_scatter() -> None:
    draw = np.random.default_rng(7)
    reference = draw.uniform(0.02, 0.2, 8)
    better = (reference - 0.01 + draw.uniform(-0.002, 0.002, 8)) * np.array([1, -1] * 4)
    gain = gain_over(better, reference)
    assert gain.high is not None
    assert gain.value == pytest.approx(-0.01, abs=0.002)
    assert gain.high < -0.005


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, math.nan])
def test_a_confidence_that_is_none_is_refused(confidence: float) -> None:
    with pytest.raises(InputError, match="must lie between 0 and 1"):
        errors_of([0.01, 0.02, 0.03], confidence)


def test_no_difference_at_all_is_refused() -> None:
    with pytest.raises(TooFewData, match="no mixture is both measured and predicted"):
        errors_of([])


def test_the_best_constant_is_the_mean_of_the_others() -> None:
    assert best_constant([0.6, 0.63, 0.69]) == pytest.approx([0.66, 0.645, 0.615])
    with pytest.raises(TooFewData, match="takes 2 measured mixtures, here 1"):
        best_constant([0.6])


def left_out(measured: np.ndarray) -> list[LeftOut]:
    found = fitted_to_the_others(THREE, SHARES, measured)
    assert all(isinstance(one, LeftOut) for one in found)
    return [one for one in found if isinstance(one, LeftOut)]


def test_the_index_is_that_of_a_fit_without_the_mixture() -> None:
    for k, one in enumerate(left_out(MEASURED)):
        others = np.arange(len(MEASURED)) != k
        alone = fit_compaction_index(THREE, SHARES[others], MEASURED[others])
        assert one.index == pytest.approx(alone.value, rel=1e-4)
        assert one.packing_density == pytest.approx(cpm(THREE, SHARES[[k]], alone.value)[0], abs=1e-5)


def test_a_mixtures_own_measurement_does_not_touch_what_is_fitted_for_it() -> None:
    before = left_out(MEASURED)
    for k in range(len(MEASURED)):
        measured = MEASURED.copy()
        measured[k] += 0.01
        after = left_out(measured)
        assert after[k].index == pytest.approx(before[k].index, rel=1e-9)
        assert any(abs(after[j].index - before[j].index) > 1e-3 for j in range(len(MEASURED)) if j != k)
        assert best_constant(measured)[k] == pytest.approx(best_constant(MEASURED)[k], abs=1e-15)


def test_the_aggregates_own_compaction_says_nothing_where_k_is_fitted() -> None:
    rodded = [replace(material, compaction="rodded") for material in THREE]
    assert fitted_to_the_others(rodded, SHARES, MEASURED) == fitted_to_the_others(THREE, SHARES, MEASURED)


def test_an_index_fitted_to_fewer_than_two_others_is_absent_with_the_reason() -> None:
    for found in fitted_to_the_others(THREE, SHARES[:2], MEASURED[:2]):
        assert isinstance(found, TooFewData)
        assert "1 other mixtures depend on the compaction index K, it takes 2" in str(found)
    shares, measured = np.vstack([SHARES[:2], [[1.0, 0.0, 0.0]]]), np.append(MEASURED[:2], 0.6)
    first, second, alone = fitted_to_the_others(THREE, shares, measured)
    assert isinstance(first, TooFewData)
    assert isinstance(second, TooFewData)
    assert isinstance(alone, LeftOut)  # an aggregate alone does not depend on K, the two others do
    assert alone.packing_density == pytest.approx(0.6)


def test_an_index_at_an_end_of_its_range_is_absent_with_the_reason() -> None:
    for found in fitted_to_the_others(THREE, SHARES, MEASURED - 0.1):
        assert isinstance(found, OutOfReach)
        assert "lies at an end of its range" in str(found)
