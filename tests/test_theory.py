"""Analytical packing models: their limits, their laws, published values, and what they refuse."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from pdlab import theory
from pdlab.density import COMPACTIONS
from pdlab.errors import DensityError, GradingError, InputError, OutOfReach, ProtocolError, ShareError, TooFewData
from pdlab.lab import SHIPPED
from pdlab.theory import THEORIES, Material, cpm, fit_compaction_index, furnas, toufar, volume_mean

SAND = Material(0.62, 0.64, (0.177, 0.354, 0.707, 1.41, 2.83), (0.15, 0.3, 0.3, 0.15, 0.1))
GRAVEL = Material(11.0, 0.58, (5.66, 11.3, 22.6), (0.3, 0.5, 0.2))
SPHERES = [Material(1.0, 0.6), Material(3.0, 0.6)]

every_theory = pytest.mark.parametrize("model", THEORIES.values(), ids=THEORIES)


@st.composite
def mixtures(draw: st.DrawFn, least: int = 2) -> tuple[list[Material], list[float]]:
    """Two to four aggregates of one class each, and their shares, zeros and near zeros among them."""
    count = draw(st.integers(least, 4))
    sizes = st.sampled_from([0.1, 0.5, 1.0, 1.5, 20.0]) | st.floats(0.1, 100.0)
    materials = [Material(draw(sizes), draw(st.floats(0.35, 0.75))) for _ in range(count)]
    parts = [draw(st.just(0.0) | st.floats(1e-15, 1e-3) | st.floats(0.01, 1.0)) for _ in range(count)]
    total = math.fsum(parts)
    return materials, [part / total for part in parts] if total > 0.0 else [1.0, *[0.0] * (count - 1)]


@every_theory
@pytest.mark.parametrize("compaction", COMPACTIONS)
def test_an_aggregate_alone_has_its_measured_packing_density(model: theory.Theory, compaction: str) -> None:
    aggregates = [replace(SAND, compaction=compaction), GRAVEL, SPHERES[0]]
    out = model(aggregates, np.eye(3), compaction)
    assert out == pytest.approx([0.64, 0.58, 0.6], abs=1e-12)


@every_theory
@given(densities=st.lists(st.floats(0.35, 0.75), min_size=3, max_size=3))
def test_bulk_volumes_of_equal_sizes_add_up(model: theory.Theory, densities: list[float]) -> None:
    aggregates = [Material(4.0, density) for density in densities]
    shares = np.array([[0.2, 0.3, 0.5]])
    assert 1.0 / model(aggregates, shares, "loose") == pytest.approx(shares @ (1.0 / np.array(densities)), rel=1e-12)


@every_theory
@given(mixture=mixtures(), data=st.data())
def test_the_order_of_the_aggregates_does_not_matter(
    model: theory.Theory, mixture: tuple[list[Material], list[float]], data: st.DataObject
) -> None:
    materials, shares = mixture
    order = data.draw(st.permutations(range(len(materials))))
    turned = model([materials[k] for k in order], [[shares[k] for k in order]], "loose")
    assert turned == pytest.approx(model(materials, [shares], "loose"), rel=1e-11)


@every_theory
@given(mixture=mixtures(), part=st.floats(0.0, 1.0))
def test_an_aggregate_in_two_heaps_is_one_aggregate(
    model: theory.Theory, mixture: tuple[list[Material], list[float]], part: float
) -> None:
    materials, shares = mixture
    heaps = model([*materials, materials[0]], [[shares[0] * part, *shares[1:], shares[0] * (1.0 - part)]], "loose")
    assert heaps == pytest.approx(model(materials, [shares], "loose"), rel=1e-9)


@every_theory
@given(mixture=mixtures(), other=st.floats(0.1, 100.0))
def test_an_absent_aggregate_changes_nothing(
    model: theory.Theory, mixture: tuple[list[Material], list[float]], other: float
) -> None:
    materials, shares = mixture
    more = model([*materials, Material(other, 0.5)], [[*shares, 0.0]], "loose")
    assert more == pytest.approx(model(materials, [shares], "loose"), rel=1e-12)


def test_an_absent_aggregate_that_would_be_dominant_changes_nothing() -> None:
    aggregates, between = [Material(5.35, 0.427), Material(3.06, 0.419)], Material(4.78, 0.9)
    out = cpm(aggregates, [[0.6, 0.4]], 1e4)
    assert cpm([*aggregates, between], [[0.6, 0.4, 0.0]], 1e4) == pytest.approx(out, rel=1e-12)
    graded = Material(4.0, 0.42, (5.35, 3.06), (0.6, 0.4))
    for trace in (0.0, 5e-324, 1e-200):
        traced = replace(graded, sizes=(5.35, 4.78, 3.06), shares=(0.6, trace, 0.4))
        assert theory.residual_packing(traced, 1e4) == pytest.approx(theory.residual_packing(graded, 1e4), rel=1e-12)


@every_theory
@pytest.mark.parametrize("trace", [5e-324, 1e-310, 1e-200, 1e-16])
def test_a_trace_of_an_aggregate_changes_nothing_that_is_seen(model: theory.Theory, trace: float) -> None:
    for k in range(3):
        shares = np.array([0.5, 0.5, 0.5])
        shares[k] = trace
        exact = model([SAND, GRAVEL, SPHERES[1]], [np.where(shares > 0.1, shares, 0.0)], "loose")
        assert model([SAND, GRAVEL, SPHERES[1]], [shares], "loose") == pytest.approx(exact, rel=1e-9)


@every_theory
@given(mixture=mixtures())
def test_every_mixture_has_a_packing_density_between_0_and_1(
    model: theory.Theory, mixture: tuple[list[Material], list[float]]
) -> None:
    assert 0.0 < model(mixture[0], [mixture[1]], "loose")[0] < 1.0


@every_theory
def test_many_mixtures_at_once_are_the_same_as_one_by_one(model: theory.Theory) -> None:
    shares = np.random.default_rng(1).dirichlet(np.ones(3), 50)
    aggregates = [SAND, GRAVEL, SPHERES[1]]
    assert model(aggregates, shares, "rodded") == pytest.approx(
        [model(aggregates, [row], "rodded")[0] for row in shares], rel=1e-12
    )


@every_theory
@given(mixture=mixtures(), step=st.floats(1e-9, 1e-7))
def test_packing_density_goes_on_without_a_leap_where_shares_change(
    model: theory.Theory, mixture: tuple[list[Material], list[float]], step: float
) -> None:
    materials, shares = mixture
    moved = [(1.0 - step) * share for share in shares]
    moved[0] += step
    # the constants of Toufar's model leave a leap of 0.0005 in the filling factor, at one ratio
    leap = 3e-4 if model is toufar else 1e-6
    assert model(materials, [moved], "loose") == pytest.approx(model(materials, [shares], "loose"), abs=leap)


@given(mixture=mixtures(), index=st.floats(4.1, 1e6))
def test_nothing_packs_denser_than_at_infinite_size_ratios(
    mixture: tuple[list[Material], list[float]], index: float
) -> None:
    materials, shares = mixture
    bound = furnas(materials, [shares])[0] + 1e-12
    assert toufar(materials, [shares])[0] <= bound
    assert cpm(materials, [shares], index)[0] <= bound


# --- Furnas


def test_furnas_two_equally_dense_sizes_are_densest_at_1_over_1_plus_voids() -> None:
    """Furnas 1931, p. 1052: the coarse share is 1/(1 + V), of voids V in either, and V² is left."""
    voids = 0.4
    aggregates = [Material(0.01, 1.0 - voids), Material(10.0, 1.0 - voids)]
    coarse = np.linspace(0.0, 1.0, 7001)
    out = furnas(aggregates, np.column_stack([1.0 - coarse, coarse]))
    assert coarse[out.argmax()] == pytest.approx(1.0 / (1.0 + voids), abs=1.5e-4)
    assert out.max() == pytest.approx(1.0 - voids**2, abs=1e-4)


def test_furnas_is_the_smaller_of_filled_voids_and_floating_grains() -> None:
    aggregates = [Material(20.0, 0.55), Material(0.1, 0.65)]
    for fine in (0.1, 0.2, 0.3, 0.5, 0.9):
        expected = min(0.55 / (1.0 - fine), 1.0 / (1.0 - fine + fine / 0.65))
        assert furnas(aggregates, [[1.0 - fine, fine]])[0] == pytest.approx(expected, rel=1e-12)


def test_furnas_three_sizes_fill_one_anothers_voids() -> None:
    aggregates = [Material(100.0, 0.6), Material(1.0, 0.6), Material(0.01, 0.6)]
    solid = np.array([0.6, 0.4 * 0.6, 0.4 * 0.4 * 0.6])
    assert furnas(aggregates, [solid / solid.sum()])[0] == pytest.approx(1.0 - 0.4**3, rel=1e-12)


# --- Toufar


@pytest.mark.parametrize(("fine", "filled"), [(0.5, 1.0 - 11.0 / 3.5**4), (0.1, 0.3881 * (1.0 / 3.6) / 0.4753)])
def test_toufar_by_hand_above_and_below_the_linear_part(fine: float, filled: float) -> None:
    """Sizes 1 and 3, φ = 0.6: k_d = 1/2, x = (r1/r2)/0.4, which is 2.5 and 1/3.6."""
    coarse = 1.0 - fine
    volume = fine / 0.6 + coarse / 0.6 - coarse * (1.0 / 0.6 - 1.0) * 0.5 * filled
    assert toufar(SPHERES, [[fine, coarse]])[0] == pytest.approx(1.0 / volume, rel=1e-12)


def test_toufar_three_sizes_are_combined_from_the_finest_up_at_the_log_mean_diameter() -> None:
    fine, middle, coarse = Material(0.5, 0.62), Material(2.0, 0.57), Material(16.0, 0.6)
    pair = toufar([fine, middle], [[0.6, 0.4]])[0]
    combined = Material(0.5**0.6 * 2.0**0.4, pair)
    expected = toufar([combined, coarse], [[0.5, 0.5]])
    assert toufar([coarse, fine, middle], [[0.5, 0.3, 0.2]]) == pytest.approx(expected, rel=1e-12)


def test_toufar_reaches_furnas_where_fine_grains_abound_at_a_great_size_ratio() -> None:
    aggregates = [Material(1e-4, 0.6), Material(1e4, 0.6)]
    assert toufar(aggregates, [[0.9, 0.1]]) == pytest.approx(furnas(aggregates, [[0.9, 0.1]]), abs=1e-5)


# --- the compressible packing model


def longhand(materials: Sequence[Material], shares: Sequence[float], index: float) -> float:
    """De Larrard's equations as he writes them, class by class; one class to an aggregate."""
    beta = [material.packing_density * (1.0 + 1.0 / index) for material in materials]
    size = [material.diameter for material in materials]
    gamma = []
    for i in range(len(size)):
        less = 0.0
        for j in range(len(size)):
            if size[j] > size[i]:
                b = 1.0 - (1.0 - size[i] / size[j]) ** 1.5
                less += (1.0 - beta[i] + b * beta[i] * (1.0 - 1.0 / beta[j])) * shares[j]
            elif j != i:
                a = math.sqrt(1.0 - (1.0 - size[j] / size[i]) ** 1.02)
                less += (1.0 - a * beta[i] / beta[j]) * shares[j]
        gamma.append(beta[i] / (1.0 - less))

    def compaction(density: float) -> float:
        return sum(y / b / (1.0 / density - 1.0 / g) for y, b, g in zip(shares, beta, gamma, strict=True)) - index

    return brentq(compaction, 1e-3, min(gamma) * (1.0 - 1e-12), xtol=1e-14)


@pytest.mark.parametrize("index", [4.1, 4.75, 9.0, 100.0])
def test_cpm_is_de_larrards_equations_written_out(index: float) -> None:
    materials = [Material(8.0, 0.55), Material(0.3, 0.63), Material(2.0, 0.6), Material(40.0, 0.57)]
    for shares in np.random.default_rng(3).dirichlet(np.ones(4), 20):
        assert cpm(materials, [shares], index)[0] == pytest.approx(longhand(materials, shares, index), rel=1e-9)


@given(density=st.floats(0.3, 0.75), index=st.floats(4.1, 1e4))
def test_cpm_residual_packing_density_of_one_class(density: float, index: float) -> None:
    beta = theory.residual_packing(Material(5.0, density), index)
    assert beta == pytest.approx(density * (1.0 + 1.0 / index), rel=1e-12)


def test_cpm_residual_packing_density_of_a_wide_grading_is_below_that_of_one_class() -> None:
    assert theory.residual_packing(SAND, 4.1) < 0.9 * SAND.packing_density * (1.0 + 1.0 / 4.1)


def test_cpm_a_class_in_two_parts_is_one_class() -> None:
    halves = replace(GRAVEL, sizes=(5.66, 11.3, 11.3, 22.6), shares=(0.3, 0.1, 0.4, 0.2))
    shares = [[0.4, 0.6]]
    assert cpm([SAND, halves], shares, 4.5) == pytest.approx(cpm([SAND, GRAVEL], shares, 4.5), rel=1e-12)


@given(mixture=mixtures(), grown=st.floats(1e-9, 1e-7))
def test_cpm_goes_on_without_a_leap_where_sizes_become_equal(
    mixture: tuple[list[Material], list[float]], grown: float
) -> None:
    materials, shares = mixture
    same = [materials[0], replace(materials[1], diameter=materials[0].diameter, sizes=(), shares=()), *materials[2:]]
    size = materials[0].diameter * (1.0 + grown)
    apart = [same[0], replace(same[1], diameter=size, sizes=(), shares=()), *same[2:]]
    assert cpm(apart, [shares]) == pytest.approx(cpm(same, [shares]), abs=1e-3 * math.sqrt(grown / 1e-7))


def test_cpm_reaches_furnas_at_great_size_ratios_and_compaction() -> None:
    aggregates = [Material(1e-4, 0.62), Material(1e4, 0.57)]
    shares = np.column_stack([np.linspace(0.0, 1.0, 21), np.linspace(1.0, 0.0, 21)])
    assert cpm(aggregates, shares, 1e9) == pytest.approx(furnas(aggregates, shares), abs=1e-4)


def test_cpm_an_aggregate_measured_loose_packs_denser_when_it_is_compacted() -> None:
    loose = [replace(SAND, compaction="loose"), replace(GRAVEL, compaction="unstated")]
    for shares in ([1.0, 0.0], [0.4, 0.6]):
        out = [cpm(loose, [shares], way)[0] for way in ("loose", "rodded", "vibrated", "vibrated_under_pressure")]
        assert out == sorted(out)
        assert out[1] - out[0] > 0.003
    assert cpm(loose, [[1.0, 0.0]], "loose")[0] == pytest.approx(SAND.packing_density)


def test_cpm_finds_a_residual_packing_density_below_1_just_above_the_index_that_its_error_names() -> None:
    dense = Material(16.0, 0.82)
    with pytest.raises(DensityError, match=r"0\.82 .* residual packing density of 1\.02 at K = 4\.1") as refused:
        cpm([dense, SAND], [[0.5, 0.5]], "loose")
    assert "K above 4.556 would do" in str(refused.value)
    assert theory.residual_packing(dense, 4.5557) < 1.0
    with pytest.raises(DensityError):
        theory.residual_packing(dense, 4.5555)


# --- the compaction index of a laboratory

LAB = [SAND, GRAVEL, Material(4.0, 0.59)]
TESTED = np.array([[0.5, 0.5, 0.0], [0.3, 0.7, 0.0], [0.3, 0.4, 0.3], [0.0, 0.6, 0.4], [1.0, 0.0, 0.0]])


@pytest.mark.parametrize("index", [3.5, 5.2, 8.0])
def test_a_laboratorys_index_is_found_again_from_its_mixtures(index: float) -> None:
    as_tested = [replace(one, compaction="vibrated") for one in LAB]
    fitted = fit_compaction_index(as_tested, TESTED, cpm(LAB, TESTED, index))
    assert fitted.value == pytest.approx(index, rel=1e-4)
    assert fitted.rms_error < 1e-6
    assert fitted.mixtures == 4  # the aggregate alone says nothing about K


def test_a_fitted_index_leaves_less_than_any_other() -> None:
    measured = cpm(LAB, TESTED, 5.0) + np.array([0.004, -0.003, 0.002, -0.005, 0.0])
    fitted = fit_compaction_index(LAB, TESTED, measured)
    for index in (0.97 * fitted.value, 1.03 * fitted.value):
        left = (cpm(LAB, TESTED[:4], index) - measured[:4]) ** 2
        assert math.sqrt(left.mean()) > fitted.rms_error


@pytest.mark.parametrize(
    ("shares", "depend"), [(TESTED[:1], 1), (TESTED[4:], 0), (TESTED[[0, 4, 4]], 1)], ids=["one", "alone", "two alone"]
)
def test_an_index_is_not_fitted_to_fewer_than_two_mixtures(shares: np.ndarray, depend: int) -> None:
    with pytest.raises(TooFewData, match=f"^{depend} measured mixtures depend .* it takes 2"):
        fit_compaction_index(LAB, shares, np.full(len(shares), 0.65))


def test_an_index_is_not_fitted_to_mixtures_of_equal_sizes() -> None:
    with pytest.raises(TooFewData, match=r"^0 measured mixtures depend"):
        fit_compaction_index([Material(4.0, 0.55), Material(4.0, 0.6)], [[0.5, 0.5], [0.2, 0.8]], [0.58, 0.59])


def test_mixtures_looser_than_the_model_at_any_index_are_refused() -> None:
    with pytest.raises(OutOfReach, match="no compaction index K between"):
        fit_compaction_index(LAB, TESTED[:3], [0.60, 0.60, 0.60])


def test_a_fit_to_mixtures_denser_than_the_model_at_any_index_says_how_bad_it_is() -> None:
    assert fit_compaction_index(LAB, TESTED[:3], [0.9, 0.9, 0.9]).rms_error > 0.1


# --- published measurements


def test_ferets_pebbles_by_every_theory() -> None:
    """Mean absolute errors; another program found 0.011 for Toufar and 0.0115 for the CPM. Nothing is fitted."""
    alone = pd.read_csv(SHIPPED.parent / "feret_coarse_fractions.csv")
    mixed = pd.read_csv(SHIPPED.parent / "feret_pebble_mixtures.csv")
    sizes = np.sqrt(alone.passing_ring_mm_converted * alone.held_by_ring_mm_converted)
    pebbles = [Material(d, pd) for d, pd in zip(sizes, alone.packing_density_round_pebbles, strict=True)]
    shares = mixed[["frac_L", "frac_M", "frac_F"]].to_numpy()

    def error(model: Callable[..., theory.Floats]) -> float:
        return float(np.abs(model(pebbles, shares, "unstated") - mixed.packing_density).mean())

    assert error(toufar) == pytest.approx(0.0106, abs=1e-4)
    assert error(cpm) == pytest.approx(0.0115, abs=1e-4)
    assert error(volume_mean) == pytest.approx(0.0373, abs=1e-4)
    assert error(furnas) == pytest.approx(0.1085, abs=1e-4)
    fitted = fit_compaction_index(pebbles, shares, mixed.packing_density)
    assert (fitted.value, fitted.rms_error) == pytest.approx((2.293, 0.00686), rel=1e-3)


# --- what is refused


@every_theory
@pytest.mark.parametrize(
    ("shares", "message"),
    [
        ([[0.5, 0.6]], "mixture 1 sum to 1.1"),
        ([[0.5, 0.5], [0.2, 0.7]], "mixture 2 sum to 0.9"),
        ([[-0.1, 1.1]], "share -0.1 in mixture 1"),
        ([[math.nan, 1.0]], "share nan in mixture 1"),
        ([[math.inf, 0.0]], "share inf in mixture 1"),
        ([0.5, 0.5], "2 aggregates"),
        ([[0.5, 0.3, 0.2]], "2 aggregates"),
    ],
)
def test_shares_that_are_none_are_refused(model: theory.Theory, shares: Any, message: str) -> None:
    with pytest.raises(ShareError, match=message):
        model(SPHERES, shares, "loose")


def test_a_mixture_of_nothing_is_refused() -> None:
    with pytest.raises(ShareError, match="0 aggregates"):
        toufar([], [[]])


@pytest.mark.parametrize(
    ("fields", "error", "message"),
    [
        ({"diameter": -1.0}, GradingError, "size -1 mm"),
        ({"diameter": 0.0}, GradingError, "size 0 mm"),
        ({"diameter": math.nan}, GradingError, "size nan mm"),
        ({"diameter": math.inf}, GradingError, "size inf mm"),
        ({"packing_density": 0.0}, DensityError, "packing density 0 must"),
        ({"packing_density": 1.0}, DensityError, "packing density 1 must"),
        ({"packing_density": 58.0}, DensityError, "packing density 58 must"),
        ({"packing_density": math.nan}, DensityError, "packing density nan must"),
        ({"sizes": (1.0, 2.0)}, GradingError, "2 sizes and 0 shares"),
        ({"sizes": (1.0, -2.0), "shares": (0.5, 0.5)}, GradingError, "size -2 mm"),
        ({"sizes": (1.0, 2.0), "shares": (0.5, 0.4)}, GradingError, "sum to 0.9"),
        ({"sizes": (1.0, 2.0), "shares": (1.5, -0.5)}, GradingError, "share 1.5 of a class"),
        ({"compaction": "stamped"}, ProtocolError, "'stamped' has no index"),
    ],
)
def test_what_is_no_aggregate_is_refused(fields: dict[str, Any], error: type[InputError], message: str) -> None:
    with pytest.raises(error, match=message):
        Material(**{"diameter": 4.0, "packing_density": 0.6} | fields)


@pytest.mark.parametrize("compaction", ["stamped", 0.0, -4.1, math.nan, math.inf])
def test_a_compaction_without_an_index_is_refused(compaction: str | float) -> None:
    with pytest.raises(ProtocolError, match="index"):
        cpm(SPHERES, [[0.5, 0.5]], compaction)


@pytest.mark.parametrize("model", [furnas, toufar, volume_mean])
def test_theories_without_compaction_do_not_mix_it(model: Callable[..., theory.Floats]) -> None:
    loose = [replace(SPHERES[0], compaction="loose"), replace(SPHERES[1], compaction="unstated")]
    model(loose, [[0.5, 0.5]], "loose")
    with pytest.raises(ProtocolError, match="cannot mix loose and rodded"):
        model(loose, [[0.5, 0.5]], "rodded")


def test_measured_packing_densities_to_fit_are_checked() -> None:
    with pytest.raises(DensityError, match="packing density 64 lies"):
        fit_compaction_index(LAB, TESTED[:2], [0.7, 64.0])
    with pytest.raises(ShareError, match="1 measured packing densities for 2 mixtures"):
        fit_compaction_index(LAB, TESTED[:2], [0.7])


def test_theories_are_known_by_name_and_dewars_as_absent() -> None:
    assert {name: theory.theory(name) for name in THEORIES} == THEORIES
    with pytest.raises(InputError, match="'dewar' is absent: the equations of Dewar"):
        theory.theory("dewar")
    with pytest.raises(InputError, match="'fuller' is no theory; use one of furnas, toufar, cpm"):
        theory.theory("fuller")


@settings(max_examples=30)
@given(
    sizes=st.lists(st.floats(1e-4, 1e4), min_size=1, max_size=8),
    density=st.floats(1e-3, 0.79),
    weights=st.lists(st.sampled_from([5e-324, 1e-300, 1e-13]) | st.floats(1e-6, 1.0), min_size=8, max_size=8),
)
def test_cpm_holds_for_any_grading(sizes: list[float], density: float, weights: list[float]) -> None:
    parts = [weight / math.fsum(weights[: len(sizes)]) for weight in weights[: len(sizes)]]
    graded = Material(sizes[0], density, tuple(sizes), tuple(parts))
    assert cpm([graded], [[1.0]], "loose")[0] == pytest.approx(density, rel=1e-9)
