"""A bulk-density test and a particle density → the measured packing density and its error."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pdlab.errors import DensityError

WATER_DENSITY = 997.5
"""kg/m³, water at 23 °C, the temperature of ASTM C127 and C128."""
LIGHTEST, HEAVIEST = 100.0, 25_000.0
"""Particle densities in kg/m³ outside which an entry is a typing error or in another unit."""
MAX_DEVIATION = 0.05
"""Standard deviation of single tests, in PD, above which it is a typing error or in another unit."""
DEFAULT_ERROR = 0.005
"""Standard error of a measured PD whose test states no repeats."""
BASES = ("oven_dry", "ssd", "apparent")
COMPACTIONS = ("loose", "rodded", "vibrated", "unstated")


@dataclass(frozen=True)
class Measure:
    """A standard cylindrical measure: its ``volume`` [L] and the ``largest`` nominal size [mm] that it is for."""

    volume: float
    largest: float

    @property
    def diameter(self) -> float:
        """Inner diameter [mm], taken equal to the height where only the name is known."""
        return 1e2 * math.cbrt(4.0 * self.volume / math.pi)


MEASURES = {
    "ASTM C29": tuple(
        Measure(volume, largest)
        for volume, largest in ((2.8, 12.5), (9.3, 25.0), (14.0, 37.5), (28.0, 75.0), (70.0, 100.0), (100.0, 125.0))
    ),
    "EN 1097-3": tuple(
        Measure(volume, largest) for volume, largest in ((1.0, 4.0), (5.0, 16.0), (10.0, 31.5), (20.0, 63.0))
    ),
}
"""Volumes by nominal maximum size, from memory of the standards' tables: check them against your copy."""


def standard_measure(standard: str, largest: float) -> Measure:
    """Return the smallest measure of a ``standard`` for a nominal maximum size ``largest`` [mm].

    Raises DensityError.
    """
    if standard not in MEASURES:
        raise DensityError(f"standard '{standard}' has no measures here; use one of {', '.join(MEASURES)}")
    fitting = [measure for measure in MEASURES[standard] if largest <= measure.largest]
    if not fitting:
        raise DensityError(
            f"{standard} has no measure for {largest:g} mm, its largest is for {MEASURES[standard][-1].largest:g} mm; "
            "give the container's diameter and height"
        )
    return fitting[0]


@dataclass(frozen=True)
class MeasuredPacking:
    """A measured packing density [-], its standard error [-], and what was assumed on the way."""

    packing_density: float
    standard_error: float
    warnings: tuple[str, ...] = ()

    @property
    def value(self) -> float:
        """The packing density, by the name that whatever a calibration may be held against has."""
        return self.packing_density


def oven_dry_density(density: float, basis: str, absorption_percent: float | None = None) -> float:
    """Return the oven-dry particle density [kg/m³] from one on another basis.

    ``density`` [kg/m³] on ``basis`` (oven_dry, ssd, apparent); ``absorption_percent``: water
    absorption in percent of the dry mass. Raises DensityError. Source: the definitions of ASTM C127.
    """
    if not LIGHTEST <= density <= HEAVIEST:
        raise DensityError(
            f"particle density {density:g} kg/m³ lies outside [{LIGHTEST:g}, {HEAVIEST:g}]; enter it in kg/m³"
        )
    if basis not in BASES:
        raise DensityError(f"density basis '{basis}' is unknown; use one of {', '.join(BASES)}")
    if basis == "oven_dry":
        return density
    if absorption_percent is None:
        raise DensityError(
            f"a particle density on the basis '{basis}' needs the water absorption to become oven-dry; "
            "enter water_absorption_percent"
        )
    if not 0.0 <= absorption_percent < 100.0:
        raise DensityError(f"water absorption {absorption_percent:g} % must lie in [0, 100); enter percent of dry mass")
    if basis == "ssd":
        return density / (1.0 + absorption_percent / 100.0)
    return 1.0 / (1.0 / density + absorption_percent / 100.0 / WATER_DENSITY)


def measured_packing(
    kind: str,
    value: float,
    particle_density: float | None = None,
    repeats: int | None = None,
    standard_deviation: float | None = None,
) -> MeasuredPacking:
    """Return the measured packing density of a density test.

    ``kind``: bulk_density_kg_m3 (needs the oven-dry ``particle_density`` [kg/m³]), voids_percent or
    packing_density. ``standard_deviation`` is that of single tests, in the unit of ``value``; the mean
    of ``repeats`` has it over √repeats; without it 0.005 in PD is taken and said. Raises DensityError.
    """
    scale, packing = 1.0, value
    if kind == "bulk_density_kg_m3":
        if particle_density is None:
            raise DensityError(
                f"bulk density {value:g} kg/m³ needs a particle density to become a packing density; "
                "enter particle_density_kg_m3 and density_basis"
            )
        scale = 1.0 / particle_density
        packing = value * scale
    elif kind == "voids_percent":
        scale, packing = 0.01, 1.0 - value / 100.0
    elif kind != "packing_density":
        raise DensityError(f"'{kind}' is no density test; give bulk_density_kg_m3, voids_percent or packing_density")
    if not 0.0 < packing < 1.0:
        raise DensityError(
            f"{kind} {value:g} gives a packing density of {packing:.4g}, outside (0, 1); check the value and its unit"
        )
    if repeats is not None and repeats < 1:
        raise DensityError(f"repeats {repeats} must be at least 1; leave it empty when unknown")
    if standard_deviation is None:
        note = f"no standard deviation stated: a standard error of {DEFAULT_ERROR:g} in PD is assumed"
        return MeasuredPacking(packing, DEFAULT_ERROR, (note,))
    if not (math.isfinite(standard_deviation) and standard_deviation >= 0.0):
        raise DensityError(
            f"standard deviation {standard_deviation:g} must not be negative; leave it empty when unknown"
        )
    if standard_deviation * scale > MAX_DEVIATION:
        raise DensityError(
            f"standard deviation {standard_deviation:g} is {standard_deviation * scale:.3g} in PD, more than "
            f"{MAX_DEVIATION:g}; enter it in the unit of the value, or leave it empty when unknown"
        )
    return MeasuredPacking(packing, standard_deviation * scale / math.sqrt(repeats or 1))


def voids_percent(packing_density: float) -> float:
    """Return the voids [%] between the grains of a packing density [-]."""
    return 100.0 * (1.0 - packing_density)


def void_volume(packing_density: float) -> float:
    """Return the voids [L] in a cubic metre of aggregate of a packing density [-], which paste must fill at least."""
    return 1000.0 * (1.0 - packing_density)


def bulk_density(packing_density: float, particle_density: float) -> float:
    """Return the oven-dry bulk density [kg/m³] of a packing density [-] and an oven-dry particle density [kg/m³]."""
    return packing_density * particle_density


def mass_shares(solid_volume_shares: Sequence[float], particle_densities: Sequence[float]) -> list[float]:
    """Return mass shares [-] from solid-volume shares [-] and oven-dry particle densities [kg/m³]."""
    masses = [share * density for share, density in zip(solid_volume_shares, particle_densities, strict=True)]
    total = sum(masses)
    return [mass / total for mass in masses]


def solid_volume_shares(mass_shares: list[float], particle_densities: list[float]) -> list[float]:
    """Return solid-volume shares [-] from mass shares [-] and oven-dry particle densities [kg/m³]."""
    volumes = [share / density for share, density in zip(mass_shares, particle_densities, strict=True)]
    total = sum(volumes)
    return [volume / total for volume in volumes]
