"""What gradings are called by and compared with: worked by hand."""

import numpy as np
import pytest

from pdlab.errors import GradingError
from pdlab.grading import (
    ASTM_C33_FINE,
    FULLER,
    POWER_045,
    SIEVE_SETS,
    Grading,
    SieveRow,
    SieveTable,
    check,
    fineness_modulus,
    indices,
    interpolated_sieves,
    make_grading,
    power_curve,
    retained_percents,
    size_at,
    targets,
    uniformity,
)
from pdlab.quantities import QUANTITIES
from pdlab.tables import parse_aperture

SAND = ((9.5, 0.0), (4.75, 2.0), (2.36, 13.0), (1.18, 20.0), (0.6, 20.0), (0.3, 24.0), (0.15, 18.0), (None, 3.0))
"""The sand of the PCA's Design and Control of Concrete Mixtures: percent retained on each sieve."""


def graded(*rows: tuple[float | None, float], kind: str = "retained_percent") -> Grading:
    return make_grading(SieveTable(tuple(SieveRow(*row) for row in rows), kind))


def test_the_fineness_modulus_is_the_sum_of_the_cumulative_percents_retained() -> None:
    assert fineness_modulus(graded(*SAND)) == pytest.approx((2 + 15 + 35 + 55 + 79 + 97) / 100)
    assert interpolated_sieves(graded(*SAND)) == ()


def test_sieves_coarser_than_the_grading_retain_nothing_and_finer_ones_all() -> None:
    assert fineness_modulus(graded((9.5, 0.0), (4.75, 100.0))) == pytest.approx(6.0)
    assert fineness_modulus(graded((4.0, 0.0), (2.0, 10.0), (1.0, 90.0)), "EN 12620") == pytest.approx(0.1 + 4.0)


def test_a_sieve_that_is_missing_is_interpolated_and_named() -> None:
    half = graded((9.5, 0.0), (4.75 / 2, 100.0))  # 4.75 mm lies in the middle of the class
    assert interpolated_sieves(half) == (4.75,)
    assert fineness_modulus(half) == pytest.approx(0.5 + fineness_modulus(graded((4.75, 0.0), (4.75 / 2, 100.0))))


def test_a_standard_without_a_fineness_modulus_is_named() -> None:
    with pytest.raises(GradingError, match="'DIN' has no fineness modulus here; use one of ASTM C136, EN 12620"):
        fineness_modulus(graded(*SAND), "DIN")


def test_sizes_and_uniformity_are_interpolated_over_the_logarithm() -> None:
    grading = graded((16.0, 100.0), (8.0, 70.0), (4.0, 20.0), (2.0, 5.0), (1.0, 0.0), kind="passing_percent")
    assert size_at(grading, 0.5) == pytest.approx(4.0 * 2.0**0.6)
    assert size_at(grading, 0.1) == pytest.approx(2.0 * 2.0 ** (1.0 / 3.0))
    assert uniformity(grading) == pytest.approx(2.0 ** (1.8 - 1.0 / 3.0))
    assert retained_percents(grading) == pytest.approx((0.0, 30.0, 50.0, 15.0, 5.0))


def test_fuller_passes_half_at_a_quarter_of_the_largest_size() -> None:
    np.testing.assert_allclose(power_curve([32.0, 16.0, 4.0, 1.0], 16.0, FULLER), [1.0, 1.0, 0.5, 0.25])
    assert power_curve([4.0], 16.0, POWER_045)[0] == pytest.approx(0.5358867)  # 2^-0.9


@pytest.mark.parametrize(
    ("largest", "exponent", "message"),
    [(16.0, 5.0, "exponent 5 lies outside 0.1 to 1"), (0.0, 0.5, "largest size 0 mm must be above 0")],
)
def test_what_is_no_target_is_named(largest: float, exponent: float, message: str) -> None:
    with pytest.raises(GradingError, match=message):
        power_curve([1.0], largest, exponent)


def test_the_limits_of_a_fine_aggregate_are_gradings_that_enclose_a_good_sand() -> None:
    for limit in (1, 2):
        rows = tuple(SieveRow(line[0], line[limit]) for line in ASTM_C33_FINE)
        assert check(SieveTable(rows, "passing_percent")) == []
    passing = dict(zip(graded(*SAND).apertures, 100.0 * graded(*SAND).passing, strict=True))
    assert all(low <= passing[aperture] <= high for aperture, low, high in ASTM_C33_FINE)


@pytest.mark.parametrize("name", SIEVE_SETS)
def test_every_sieve_of_a_set_is_read_and_they_fall(name: str) -> None:
    apertures = [parse_aperture(sieve) for sieve in SIEVE_SETS[name]]
    assert None not in apertures
    assert apertures == sorted(apertures, key=lambda aperture: -(aperture or 0.0))
    assert len(set(apertures)) == len(apertures)


def test_targets_reach_from_the_finest_to_the_largest_size() -> None:
    found = targets(1.0, 16.0, 0.37)
    for sizes, shares in found.values():
        assert (sizes[0], sizes[-1], shares[-1]) == pytest.approx((1.0, 16.0, 1.0))
    assert [found[name][1][0] for name in ("Fuller", "Andreassen", "0.45-power")] == pytest.approx(
        [0.25, 16.0**-0.37, 16.0**-0.45]
    )
    with pytest.raises(GradingError, match="largest size 1 mm must be above the finest one, 2 mm"):
        targets(2.0, 1.0, 0.37)


def test_indices_are_named_as_quantities() -> None:
    assert set(indices(graded(*SAND))) <= set(QUANTITIES)
    assert indices(graded(*SAND))["fineness_astm"] == pytest.approx(2.83)
