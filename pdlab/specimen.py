"""What is to be run, frozen and in reduced units, with one canonical form and its hash; what came out.

Length is the largest diameter, mass density that of its species, gravity one. Friction coefficients,
size ratios, shares and density ratios stand on a grid of four significant digits, and the grid value is
what is simulated. The module imports no engine.
"""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pdlab.errors import ProtocolError, ShareError, SpecimenTooLarge

EQUAL_SPHERES, EQUAL_WIDTH = 2500, 10.0
"""Spheres and width, in diameters, of a bed of one species."""
MIN_WIDTH, MIN_HEIGHT, MIN_OF_RAREST = 5.0, 10.0, 150
"""Least width and height of a mixture's bed, in largest diameters, and spheres of the rarest species."""
DENSEST = 0.75
"""Packing density at which a planned mixture's bed still has its least height."""
MAX_SPHERES = 100_000
SAME_DENSITY = 0.2
"""Two aggregates whose particle densities differ by less than this share are equally dense."""
SHARE_TOLERANCE = 0.0011
"""Shares given to three digits may sum to 0.999 or 1.001."""


def on_grid(value: float) -> float:
    """Return ``value`` rounded to four significant digits."""
    return float(f"{value:.4g}")


@dataclass(frozen=True)
class Protocol:
    """How a test is done, all in reduced units; a friction coefficient belongs to its protocol.

    ``compaction``: loose. ``container``: periodic, no side walls. ``local_damping``: PFC3D's α.
    ``restitution`` of a bounce. ``nominal_overlap``: the bed's weight on its floor over the contact
    modulus. ``cloud_fraction``: solid fraction of the cloud that falls. ``steps_per_collision``: time
    steps in the shortest collision. ``wall_friction``: None for the smallest friction present.
    """

    compaction: str = "loose"
    container: str = "periodic"
    local_damping: float = 0.7
    restitution: float = 0.5
    nominal_overlap: float = 0.002
    cloud_fraction: float = 0.25
    steps_per_collision: float = 10.0
    wall_friction: float | None = None

    def __post_init__(self) -> None:
        if self.compaction != "loose" or self.container != "periodic":
            raise ProtocolError(
                f"'{self.compaction}' compaction in a '{self.container}' container cannot be simulated yet, "
                "only 'loose' in 'periodic'; use a loose test"
            )
        bounds = {
            "local_damping": (0.0, 0.95), "restitution": (0.05, 1.0), "nominal_overlap": (1e-5, 0.01),
            "cloud_fraction": (0.05, 0.3), "steps_per_collision": (8.0, 1000.0), "wall_friction": (0.0, 10.0),
        }  # fmt: skip
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ProtocolError(f"{name} {value:g} lies outside [{low:g}, {high:g}]; choose a value inside")


LOOSE = Protocol()


@dataclass(frozen=True)
class Species:
    """Equal spheres: ``diameter`` over the largest, ``friction``, ``density`` over the largest's, ``count``."""

    diameter: float
    friction: float
    count: int
    density: float = 1.0


@dataclass(frozen=True)
class Specimen:
    """A bed to be simulated: species from coarse to fine, ``width`` in largest diameters, seed."""

    species: tuple[Species, ...]
    width: float
    seed: int
    protocol: Protocol = LOOSE

    @property
    def spheres(self) -> int:
        """Spheres in all."""
        return sum(kind.count for kind in self.species)

    @property
    def shares(self) -> tuple[float, ...]:
        """Solid-volume share of each species as simulated, counted in whole spheres."""
        volumes = [kind.count * kind.diameter**3 for kind in self.species]
        return tuple(volume / sum(volumes) for volume in volumes)

    @property
    def wall_friction(self) -> float:
        """Friction at the floor: the protocol's, else the smallest present."""
        given = self.protocol.wall_friction
        return min(kind.friction for kind in self.species) if given is None else given

    def canonical(self, engine_version: int) -> str:
        """Return the one JSON text that stands for this specimen under ``dem.VERSION``."""
        content: dict[str, Any] = {
            "engine_version": engine_version,
            "protocol": {**vars(self.protocol), "wall_friction": self.wall_friction},
            "seed": self.seed,
            "species": [vars(kind) for kind in self.species],
            "width": self.width,
        }
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def digest(self, engine_version: int) -> str:
        """Return the SHA-256 of the canonical form, in hexadecimal."""
        return hashlib.sha256(self.canonical(engine_version).encode()).hexdigest()


@dataclass(frozen=True)
class Packing:
    """What a run gave.

    ``packing_density`` of the bed's middle half; ``coordination_number``: contacts per sphere there,
    rattlers included; ``height`` in largest diameters; ``slab_shares`` (S,) of the solids there;
    ``largest_overlap`` over the smaller diameter; ``rest``: still or creeping.
    """

    digest: str
    packing_density: float
    coordination_number: float
    height: float
    slab_shares: tuple[float, ...]
    largest_overlap: float
    rest: str
    steps: int
    seconds: float
    engine_version: int
    warnings: tuple[str, ...] = field(default=())


def equal_spheres(friction: float, seed: int, protocol: Protocol = LOOSE) -> Specimen:
    """Return a bed of equal spheres of one ``friction`` coefficient [-]."""
    return Specimen((Species(1.0, on_grid(friction), EQUAL_SPHERES),), EQUAL_WIDTH, seed, protocol)


@dataclass(frozen=True)
class Component:
    """A mixture's part: ``diameter`` [any unit], ``friction`` [-], ``share`` of the solid volume [-].

    ``density``: oven-dry particle density [kg/m³] where known.
    """

    diameter: float
    friction: float
    share: float
    density: float | None = None


def check_shares(shares: Sequence[float]) -> None:
    """Raise ShareError unless ``shares`` are positive and sum to 1 within 0.0011, which is rounding."""
    for share in shares:
        if not 0.0 < share <= 1.0:
            raise ShareError(f"share {share:g} lies outside (0, 1]; correct it or leave the aggregate out")
    if abs(math.fsum(shares) - 1.0) > SHARE_TOLERANCE:
        raise ShareError(
            f"the shares sum to {math.fsum(shares):.6g}, more than {SHARE_TOLERANCE:g} off 1; correct them"
        )


def mixed_spheres(components: Sequence[Component], seed: int, protocol: Protocol = LOOSE) -> Specimen:
    """Return the bed of a mixture, as large as the least width, height and counts ask for.

    Components of equal spheres become one species, and a single species the bed of equal spheres.
    Raises ShareError and SpecimenTooLarge.
    """
    check_shares([part.share for part in components])
    merged = _merge(components)
    if len(merged) == 1:
        return equal_spheres(merged[0].friction, seed, protocol)
    # spheres per unit of solid volume, and the solid volume that every minimum is met with
    per_volume = [part.share / (math.pi / 6.0 * part.diameter**3) for part in merged]
    solids = max(MIN_WIDTH**2 * MIN_HEIGHT * DENSEST, MIN_OF_RAREST / min(per_volume), EQUAL_SPHERES / sum(per_volume))
    counts = [math.ceil(solids * number) for number in per_volume]
    if sum(counts) > MAX_SPHERES:
        raise SpecimenTooLarge(
            f"this mixture takes {sum(counts):,} spheres, more than the cap of {MAX_SPHERES:,}: its size ratio is "
            f"{1.0 / merged[-1].diameter:.3g} and its smallest share {min(part.share for part in merged):.3g}; "
            "leave the finest aggregate out or raise the smallest share"
        )
    width = MIN_WIDTH * (solids / (MIN_WIDTH**2 * MIN_HEIGHT * DENSEST)) ** (1.0 / 3.0)
    species = (
        Species(part.diameter, part.friction, count, part.density or 1.0)
        for part, count in zip(merged, counts, strict=True)
    )
    return Specimen(tuple(species), on_grid(width), seed, protocol)


def _merge(components: Sequence[Component]) -> list[Component]:
    """Return the components in reduced units on the grid, coarse to fine, equal ones as one."""
    largest = max(part.diameter for part in components)
    known = [part.density for part in components if part.density is not None]
    alike = len(known) < len(components) or max(known) <= (1.0 + SAME_DENSITY) * min(known)
    heaviest = max((part.diameter, part.density or 0.0) for part in components)[1]
    merged: dict[tuple[float, float, float], float] = {}
    for part in components:
        density = 1.0 if alike else on_grid((part.density or 0.0) / heaviest)
        key = (on_grid(part.diameter / largest), on_grid(part.friction), density)
        merged[key] = merged.get(key, 0.0) + part.share
    ordered = sorted(merged.items(), reverse=True)
    return [Component(d, mu, on_grid(share), density) for (d, mu, density), share in ordered]


def with_seeds(specimen: Specimen, seeds: Sequence[int]) -> list[Specimen]:
    """Return the same bed once for each seed."""
    return [replace(specimen, seed=seed) for seed in seeds]
