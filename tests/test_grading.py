"""Sieve tables, size distributions and the rules for the equivalent diameter."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdlab.errors import GradingError
from pdlab.grading import RULES, SieveRow, SieveTable, check, equivalent_diameter, equivalent_diameters, make_grading

Rows = list[tuple[float | None, float]]


def table(rows: Rows, kind: str = "retained_g", mass: float | None = None, pan: float | None = None) -> SieveTable:
    return SieveTable(tuple(SieveRow(*row) for row in rows), kind, mass, pan)


SOUND: Rows = [(16.0, 0.0), (8.0, 300.0), (4.0, 500.0), (2.0, 150.0), (None, 50.0)]


def test_retained_and_passing_say_the_same() -> None:
    retained = make_grading(table(SOUND, mass=1000.0))
    passing = make_grading(table([(16.0, 100.0), (8.0, 70.0), (4.0, 20.0), (2.0, 5.0)], "passing_percent"))
    rising = make_grading(table(SOUND[3::-1] + SOUND[4:]))
    assert retained.apertures == passing.apertures == rising.apertures == (16.0, 8.0, 4.0, 2.0, 1.0)
    np.testing.assert_allclose(retained.shares, [0.3, 0.5, 0.15, 0.05], atol=1e-12)
    np.testing.assert_allclose(passing.shares, retained.shares, atol=1e-12)
    np.testing.assert_allclose(retained.passing, [1.0, 0.7, 0.2, 0.05, 0.0], atol=1e-12)


def test_a_class_has_the_geometric_mean_of_its_apertures() -> None:
    np.testing.assert_allclose(make_grading(table([(16.0, 0.0), (4.0, 100.0)])).sizes, [8.0])


def test_a_small_pan_takes_half_the_finest_aperture_and_says_so() -> None:
    grading = make_grading(table(SOUND))
    assert grading.apertures[-1] == 1.0
    assert any("half the finest aperture, 1 mm" in text for text in grading.warnings)
    given_lower = make_grading(table(SOUND, pan=0.5))
    assert given_lower.apertures[-1] == 0.5
    assert not given_lower.warnings


@pytest.mark.parametrize(
    ("rows", "kind", "mass", "row", "message"),
    [
        ([], "retained_g", None, None, "the sieve table is empty"),
        ([(None, 5.0)], "retained_g", None, None, "the sieve table is empty"),
        ([(16.0, 0.0), (-8.0, 5.0)], "retained_g", None, 1, "aperture -8 mm must be above 0"),
        ([(16.0, 0.0), (math.nan, 5.0)], "retained_g", None, 1, "aperture nan mm must lie between"),
        ([(16.0, 0.0), (1e-150, 5.0)], "retained_g", None, 1, "must lie between 0.0001 and 10000"),
        ([(16.0, 0.0), (8.0, 5.0), (8.0, 5.0)], "retained_g", None, 2, "aperture 8 mm stands twice"),
        ([(16.0, 0.0), (8.0, -5.0)], "retained_g", None, 1, "retained_g -5 must be at least 0"),
        ([(16.0, 0.0), (8.0, 101.0)], "retained_percent", None, 1, "must be between 0 and 100"),
        ([(16.0, 0.0), (4.0, 5.0), (8.0, 5.0)], "retained_g", None, 2, "aperture 8 mm after 4 mm is out of order"),
        ([(16.0, 100.0), (8.0, 20.0), (4.0, 30.0)], "passing_percent", None, 2, "30 % pass 4 mm but only 20 % pass 8"),
        ([(16.0, 0.0), (8.0, 985.0)], "retained_g", 1000.0, None, "1.5 % off the sample mass of 1000 g, more than"),
        ([(16.0, 0.0), (8.0, 60.0), (4.0, 30.0)], "retained_percent", None, None, "10 % off 100 %, more than"),
        ([(16.0, 10.0), (8.0, 90.0)], "retained_g", None, 0, "10 % lie on the coarsest sieve, 16 mm"),
        ([(16.0, 90.0), (8.0, 0.0)], "passing_percent", None, 0, "10 % lie on the coarsest sieve, 16 mm"),
        ([(16.0, 0.0), (8.0, 85.0), (None, 15.0)], "retained_g", None, 2, "15 % fell into the pan, more than 10 %"),
        ([(16.0, 0.0), (8.0, 0.0)], "retained_g", None, None, "nothing was retained"),
        ([(16.0, 100.0), (8.0, 0.0), (None, 3.0)], "passing_percent", None, 2, "3 % pass the pan"),
        ([(16.0, 0.0), (8.0, 9.0), (None, 0.5), (None, 0.5)], "retained_g", None, 3, "the pan stands twice"),
    ],
)
def test_a_table_that_is_no_grading_is_refused_at_its_row(
    rows: Rows, kind: str, mass: float | None, row: int | None, message: str
) -> None:
    wrong = check(table(rows, kind, mass))
    assert any(message in str(error) and error.row == row for error in wrong), [(e.row, str(e)) for e in wrong]
    with pytest.raises(GradingError):
        make_grading(table(rows, kind, mass))


def test_every_wrong_row_is_named_at_once() -> None:
    wrong = check(table([(16.0, 0.0), (-8.0, -5.0), (-4.0, 5.0)]))
    assert [error.row for error in wrong] == [1, 1, 2]


def test_a_loss_within_one_percent_is_kept_as_a_warning() -> None:
    grading = make_grading(table([(16.0, 0.0), (8.0, 995.0)], mass=1000.0))
    assert sum(grading.shares) == pytest.approx(1.0)
    assert any("995 of 1000" in text for text in grading.warnings)


def test_one_class_makes_the_mean_rules_equal() -> None:
    out = equivalent_diameters(make_grading(table([(16.0, 0.0), (4.0, 100.0)])))
    assert [out[rule] for rule in ("log_mean", "harmonic", "arithmetic", "number_volume", "d50")] == pytest.approx(
        [8.0] * 5
    )
    assert out["rrsb_d63"] is None


def test_rules_by_hand_on_two_classes() -> None:
    grading = make_grading(table([(16.0, 0.0), (4.0, 75.0), (1.0, 25.0)]))  # sizes 8 and 2
    wanted = {
        "log_mean": 8.0**0.75 * 2.0**0.25,
        "harmonic": 1.0 / (0.75 / 8.0 + 0.25 / 2.0),
        "arithmetic": 6.5,
        "number_volume": (0.75 / 512.0 + 0.25 / 8.0) ** (-1.0 / 3.0),
        "d50": 4.0 * 4.0 ** (1.0 / 3.0),
    }
    for rule, value in wanted.items():
        assert equivalent_diameter(grading, rule) == pytest.approx(value), rule


def test_rrsb_finds_the_diameter_that_made_the_table() -> None:
    apertures = [31.5, 16.0, 8.0, 4.0, 2.0, 1.0]
    passing = [100.0 * (1.0 - math.exp(-((d / 9.0) ** 1.2))) for d in apertures]
    grading = make_grading(table([(120.0, 100.0), *zip(apertures, passing, strict=True)], "passing_percent"))
    assert equivalent_diameter(grading, "rrsb_d63") == pytest.approx(9.0, rel=1e-6)


def test_an_unknown_rule_is_refused_with_the_known_ones() -> None:
    with pytest.raises(GradingError, match="'mean' is no diameter rule; use one of log_mean"):
        equivalent_diameter(make_grading(table(SOUND)), "mean")


def test_a_line_that_hardly_rises_gives_no_d63() -> None:
    held = [(40.0, 0.0), (32.0, 745.067), (16.0, 0.000263), (8.0, 254.67)]
    with pytest.raises(GradingError, match="more than 1000 times beyond this table's sieves; choose log_mean"):
        equivalent_diameter(make_grading(table(held)), "rrsb_d63")


@given(
    st.lists(st.floats(0.063, 125.0), min_size=3, max_size=9, unique_by=lambda d: round(math.log(d), 3)),
    st.lists(st.floats(0.01, 1000.0), min_size=8, max_size=8),
    st.floats(0.1, 10.0),
)
def test_every_rule_lies_between_the_limits_and_scales_with_the_sieves(
    apertures: list[float], masses: list[float], factor: float
) -> None:
    falling = sorted(apertures, reverse=True)
    rows: Rows = [(falling[0], 0.0), *zip(falling[1:], masses, strict=False)]
    one = equivalent_diameters(make_grading(table(rows)))
    other = equivalent_diameters(make_grading(table([((d or 0.0) * factor, m) for d, m in rows])))
    for rule in RULES:
        value, scaled = one[rule], other[rule]
        if rule != "rrsb_d63" and value is not None and scaled is not None:
            assert falling[-1] * 0.999 <= value <= falling[0] * 1.001
            assert scaled == pytest.approx(value * factor, rel=1e-6)
