"""Bulk density, voids and particle density → measured packing density."""

import math

import pytest

from pdlab.density import (
    WATER_DENSITY,
    measured_packing,
    oven_dry_density,
    solid_volume_shares,
    standard_measure,
    voids_percent,
)
from pdlab.errors import DensityError


def test_packing_density_is_bulk_over_oven_dry_particle_density() -> None:
    assert measured_packing("bulk_density_kg_m3", 1560.0, 2600.0).packing_density == pytest.approx(0.6)
    assert measured_packing("voids_percent", 40.0).packing_density == pytest.approx(0.6)
    assert measured_packing("packing_density", 0.6).packing_density == 0.6
    assert voids_percent(0.6) == pytest.approx(40.0)


def test_bases_of_one_stone_give_one_oven_dry_density() -> None:
    dry, absorption = 2600.0, 1.5
    ssd = dry * (1.0 + absorption / 100.0)
    apparent = 1.0 / (1.0 / dry - absorption / 100.0 / WATER_DENSITY)
    assert oven_dry_density(dry, "oven_dry") == dry
    assert oven_dry_density(ssd, "ssd", absorption) == pytest.approx(dry)
    assert oven_dry_density(apparent, "apparent", absorption) == pytest.approx(dry)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((2600.0, "ssd", None), "'ssd' needs the water absorption"),
        ((2600.0, "apparent", None), "'apparent' needs the water absorption"),
        ((0.0, "oven_dry", None), "lies outside"),
        ((2.65, "oven_dry", None), "particle density 2.65 kg/m³ lies outside"),
        ((2600.0, "wet", None), "'wet' is unknown"),
        ((2600.0, "ssd", -1.0), "water absorption -1 %"),
    ],
)
def test_a_particle_density_that_cannot_be_converted_is_refused(
    arguments: tuple[float, str, float | None], message: str
) -> None:
    with pytest.raises(DensityError, match=message):
        oven_dry_density(*arguments)


@pytest.mark.parametrize(
    ("kind", "value", "particle"),
    [
        ("packing_density", 1.0, None), ("packing_density", 0.0, None), ("packing_density", -0.2, None),
        ("voids_percent", 100.0, None), ("voids_percent", 0.4e3, None), ("bulk_density_kg_m3", 2700.0, 2600.0),
        ("packing_density", float("nan"), None),
    ],
)  # fmt: skip
def test_a_packing_density_outside_0_and_1_is_refused_with_its_value(
    kind: str, value: float, particle: float | None
) -> None:
    with pytest.raises(DensityError, match=r"outside \(0, 1\); check the value and its unit"):
        measured_packing(kind, value, particle)


def test_a_bulk_density_alone_is_refused() -> None:
    with pytest.raises(DensityError, match="needs a particle density"):
        measured_packing("bulk_density_kg_m3", 1500.0)


def test_the_mean_of_repeats_has_the_deviation_over_their_root() -> None:
    assert measured_packing("voids_percent", 40.0, repeats=4, standard_deviation=1.0).standard_error == pytest.approx(
        0.005
    )
    assert measured_packing("bulk_density_kg_m3", 1560.0, 2600.0, 9, 26.0).standard_error == pytest.approx(0.01 / 3)


def test_without_a_deviation_a_stated_error_is_taken_and_said() -> None:
    measured = measured_packing("packing_density", 0.6)
    assert measured.standard_error == 0.005
    assert "0.005 in PD is assumed" in measured.warnings[0]


def test_mass_shares_become_volume_shares_by_density() -> None:
    assert solid_volume_shares([0.5, 0.5], [2600.0, 2600.0]) == pytest.approx([0.5, 0.5])
    assert solid_volume_shares([0.5, 0.5], [2000.0, 4000.0]) == pytest.approx([2 / 3, 1 / 3])


def test_a_deviation_in_another_unit_is_refused() -> None:
    with pytest.raises(DensityError, match=r"standard deviation 20 is 20 in PD, more than 0\.05"):
        measured_packing("packing_density", 0.6, repeats=3, standard_deviation=20.0)


@pytest.mark.parametrize(
    ("standard", "largest", "volume"),
    [("ASTM C29", 12.5, 2.8), ("ASTM C29", 20.0, 9.3), ("ASTM C29", 125.0, 100.0), ("EN 1097-3", 16.0, 5.0)],
)
def test_a_standard_names_the_measure_for_a_nominal_maximum_size(standard: str, largest: float, volume: float) -> None:
    measure = standard_measure(standard, largest)
    assert measure.volume == volume
    assert math.pi / 4.0 * measure.diameter**3 == pytest.approx(volume * 1e6)  # as high as wide


@pytest.mark.parametrize(("standard", "largest"), [("ASTM C29", 150.0), ("EN 1097-3", 80.0), ("DIN 1", 8.0)])
def test_a_size_or_standard_without_a_measure_is_named(standard: str, largest: float) -> None:
    with pytest.raises(DensityError, match=r"has no measure"):
        standard_measure(standard, largest)
