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
MIN_WIDTH, MIN_HEIGHT, MIN_OF_RAREST, MIN_OF_CLASS = 5.0, 10.0, 150, 30
"""Least width and height of a mixture's bed, in largest diameters, and least spheres of an aggregate, or of each
sieve class of an aggregate of several."""
DENSEST = 0.75
"""Packing density at which a planned mixture's bed still has its least height."""
DENSEST_EQUAL = 0.67
"""The same for equal spheres, which no test of ours packs denser."""
FILL_ABOVE, NARROWEST = 1.5, 3.0
"""Largest diameters by which a fill is to stand above a measure's rim, and the least width and height."""
MAX_SPHERES = 200_000
STEEPEST, DENSEST_HEAP, SURPLUS = 45.0, 0.6, 1.1
"""Angle of repose in degrees up to which a heap is planned, the packing density that it may have, and the spheres
poured over those that it then needs."""
SAME_DENSITY = 0.2
"""Two aggregates whose particle densities differ by less than this share are equally dense."""
SHARE_TOLERANCE = 0.0011
"""Shares given to three digits may sum to 0.999 or 1.001."""


def on_grid(value: float) -> float:
    """Return ``value`` rounded to four significant digits."""
    return float(f"{value:.4g}")


CONTAINERS = ("periodic", "cylinder")
PLACED = ("static", "drop_and_roll")
"""Tests by geometry alone, where no force acts and sizes and numbers are all that counts."""
PAIR_FRICTIONS = ("minimum", "mean", "geometric_mean")
"""How the friction between spheres of two aggregates follows from theirs; the paper takes the minimum."""
COMMON = (
    "local_damping", "moment_damping", "restitution", "nominal_overlap", "cloud_fraction", "steps_per_collision",
    "wall_friction",
)  # fmt: skip
OWN = {
    "loose": (),
    "rodded": ("layers", "drops", "drop_height", "drop_pause"),
    "vibrated": ("shake_periods", "shake_acceleration", "shake_amplitude"),
    "repose": ("base_diameter", "lip_height", "lift_speed"),
    **dict.fromkeys(PLACED, ()),
}
"""The settings that each compaction has beside the common ones."""
LIMITS = {
    "local_damping": (0.0, 0.95), "restitution": (0.3, 1.0), "nominal_overlap": (1e-5, 0.01),
    "cloud_fraction": (0.05, 0.3), "steps_per_collision": (8.0, 1000.0), "wall_friction": (0.0, 10.0),
    "layers": (1, 10), "drops": (0, 1000), "drop_height": (0.01, 10.0), "drop_pause": (0.1, 100.0),
    "shake_periods": (0, 100_000), "shake_acceleration": (0.0, 50.0), "shake_amplitude": (0.001, 5.0),
    "base_diameter": (12.0, 100.0), "lip_height": (0.5, 5.0), "lift_speed": (0.01, 5.0),
}  # fmt: skip
STIFF_DASHPOT, STIFF_STEPS = 0.4, 20.0
"""Restitution below which a bed's dashpots need a shorter step than its springs, and steps that are enough."""


@dataclass(frozen=True)
class Protocol:
    """How a test is done, all in reduced units; a friction coefficient belongs to its protocol.

    ``compaction``: loose, a cloud falls and settles; rodded, in ``layers`` layers, after each of which
    the container is lifted ``drop_height`` and dropped ``drops`` times, ``drop_pause`` apart; vibrated,
    loose and then ``shake_periods`` of a vertical sine of peak acceleration ``shake_acceleration`` g and
    amplitude ``shake_amplitude``. Repose, the test of the angle of repose: a cylinder is filled as loose and lifted at
    ``lift_speed``, in sqrt(g d), from a round base of ``base_diameter`` with a lip of ``lip_height`` at its edge; what
    falls off is taken away. Static and drop_and_roll: spheres are placed by geometry alone, and no other setting
    matters. ``container``: periodic, no side walls, or cylinder.
    ``local_damping``: PFC3D's α while spheres are poured and settle, on moments too with
    ``moment_damping``; compaction goes without.
    ``restitution`` of a bounce. ``nominal_overlap``: the bed's weight on its floor over the contact
    modulus, which grows with the size ratio beyond 1.5. ``cloud_fraction``: solid fraction of the cloud that
    falls. ``steps_per_collision``: time steps in the shortest collision. ``wall_friction``: None for the smallest
    friction present. ``pair_friction``: between two aggregates the minimum, mean or geometric_mean of theirs.
    Raises ProtocolError.
    """

    compaction: str = "loose"
    container: str = "periodic"
    local_damping: float = 0.7
    moment_damping: bool = False
    restitution: float = 0.5
    nominal_overlap: float = 0.002
    cloud_fraction: float = 0.25
    steps_per_collision: float = 10.0
    wall_friction: float | None = None
    layers: int = 3
    drops: int = 25
    drop_height: float = 0.5
    drop_pause: float = 2.5
    shake_periods: int = 200
    shake_acceleration: float = 3.0
    shake_amplitude: float = 0.1
    pair_friction: str = "minimum"
    base_diameter: float = 26.0
    lip_height: float = 1.0
    lift_speed: float = 0.05

    def __post_init__(self) -> None:
        vocabularies = {"compaction": tuple(OWN), "container": CONTAINERS, "pair_friction": PAIR_FRICTIONS}
        for name, known in vocabularies.items():
            if getattr(self, name) not in known:
                raise ProtocolError(f"{name} '{getattr(self, name)}' cannot be simulated; use {' or '.join(known)}")
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ProtocolError(f"{name} {value:g} lies outside [{low:g}, {high:g}]; choose a value inside")
        if self.compaction == "repose" and self.container != "cylinder":
            raise ProtocolError(f"a heap is not made in a {self.container} container; lift a cylinder")
        if self.compaction in PLACED and self.container != "periodic":
            raise ProtocolError(f"'{self.compaction}' places no spheres in a {self.container}; use container periodic")
        if self.restitution < STIFF_DASHPOT and self.steps_per_collision < STIFF_STEPS:
            raise ProtocolError(
                f"restitution {self.restitution:g} at {self.steps_per_collision:g} steps per collision: below "
                f"{STIFF_DASHPOT:g} the dashpots make so long a step unstable; take at least {STIFF_STEPS:g} steps"
            )

    def settings(self) -> dict[str, Any]:
        """Return the settings that matter to this compaction, by name; of a pair's friction all but the minimum."""
        pair = () if self.pair_friction == "minimum" else ("pair_friction",)
        others = () if self.compaction in PLACED else (*COMMON, *OWN[self.compaction], *pair)
        return {name: getattr(self, name) for name in ("compaction", "container", *others)}


LOOSE, RODDED, VIBRATED = (Protocol(compaction) for compaction in ("loose", "rodded", "vibrated"))
REPOSE = Protocol("repose", "cylinder")


def protocol_of(compaction: str) -> Protocol:
    """Return how a test of this compaction is simulated; an unstated one as loose."""
    return {"loose": LOOSE, "rodded": RODDED, "vibrated": VIBRATED, "unstated": LOOSE}[compaction]


@dataclass(frozen=True)
class Species:
    """Equal spheres: ``diameter`` over the largest, ``friction``, ``density`` over the largest's, ``count``.

    ``rolling``: the coefficient of rolling resistance, 0 for none.
    """

    diameter: float
    friction: float
    count: int
    density: float = 1.0
    rolling: float = 0.0


@dataclass(frozen=True)
class Specimen:
    """A bed to be simulated: species from coarse to fine, and the seed.

    ``width`` of the periodic box, or inner diameter of the cylinder, in largest diameters; ``height``: of
    the cylinder's rim above its floor, or to which a heap's cylinder is lifted, None without one.
    """

    species: tuple[Species, ...]
    width: float
    seed: int
    protocol: Protocol = LOOSE
    height: float | None = None

    def __post_init__(self) -> None:
        if (self.height is None) != (self.protocol.container == "periodic"):
            raise ProtocolError(
                f"a {self.protocol.container} container with a rim at {self.height}: a cylinder needs a height, "
                "a periodic box has none; correct one of them"
            )

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
        """Friction at the walls: the protocol's, else the smallest present."""
        given = self.protocol.wall_friction
        return min(kind.friction for kind in self.species) if given is None else given

    def canonical(self, engine_version: int) -> str:
        """Return the one JSON text that stands for this specimen under ``dem.VERSION``."""
        protocol, kinds = self.protocol.settings(), self.species
        if self.protocol.compaction in PLACED:
            kinds = tuple(Species(kind.diameter, 0.0, kind.count) for kind in kinds)
        else:
            protocol["wall_friction"] = self.wall_friction
        if len({kind.friction for kind in self.species}) == 1:
            protocol.pop("pair_friction", None)  # any rule gives the same friction
        content: dict[str, Any] = {
            "engine_version": engine_version, "protocol": protocol, "seed": self.seed,
            "species": [vars(kind) for kind in kinds], "width": self.width, "height": self.height,
        }  # fmt: skip
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def digest(self, engine_version: int) -> str:
        """Return the SHA-256 of the canonical form, in hexadecimal."""
        return hashlib.sha256(self.canonical(engine_version).encode()).hexdigest()


@dataclass(frozen=True)
class Packing:
    """What a run gave.

    ``packing_density`` of the bed's middle half, or of a cylinder up to its rim; ``coordination_number``:
    contacts per sphere there, rattlers included; ``height`` in largest diameters; ``slab_shares`` (S,) of
    the solids there; ``largest_overlap`` over the smaller diameter; ``rest``: still, creeping or placed.
    ``repose_angle_deg``: a heap's angle of repose [degrees], None of what is no heap; a heap's packing density is NaN.
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
    repose_angle_deg: float | None = None


def equal_spheres(friction: float, seed: int, protocol: Protocol = LOOSE, rolling: float = 0.0) -> Specimen:
    """Return a periodic bed of equal spheres of one ``friction`` and one ``rolling`` coefficient [-]."""
    one = Species(1.0, on_grid(friction), EQUAL_SPHERES, rolling=on_grid(rolling))
    return Specimen((one,), EQUAL_WIDTH, seed, protocol)


def heap_spheres(
    friction: float, seed: int, rolling: float = 0.0, wall_friction: float | None = None, protocol: Protocol = REPOSE
) -> Specimen:
    """Return the heap of equal spheres of one ``friction``, whose angle of repose is asked for.

    ``rolling`` [-]; ``wall_friction`` of base, lip and cylinder [-], None for the protocol's. The cylinder is half as
    wide as the base, and filled with more than a heap of the steepest slope takes. Raises ProtocolError.
    """
    if wall_friction is not None:
        protocol = replace(protocol, wall_friction=on_grid(wall_friction))
    radius, steepest = 0.5 * protocol.base_diameter, math.tan(math.radians(STEEPEST))
    heap = math.pi * radius**2 * (protocol.lip_height + radius * steepest / 3.0)
    count = math.ceil(SURPLUS * DENSEST_HEAP * heap / (math.pi / 6.0))
    one = Species(1.0, on_grid(friction), count, rolling=on_grid(rolling))
    height = on_grid(protocol.lip_height + radius * steepest)
    return Specimen((one,), on_grid(radius), seed, protocol, height)


@dataclass(frozen=True)
class Component:
    """A mixture's part: ``diameter`` [any unit], ``friction`` [-], ``share`` of the solid volume [-].

    ``density``: oven-dry particle density [kg/m³] where known; ``rolling``: coefficient of rolling
    resistance [-]; ``least``: spheres of it that the bed needs.
    """

    diameter: float
    friction: float
    share: float
    density: float | None = None
    rolling: float = 0.0
    least: int = MIN_OF_RAREST


Sizes = tuple[tuple[float, float], ...]
"""Spheres that stand for an aggregate: diameter [any unit] and share of its solid volume [-], coarse to fine."""


def components(
    sizes: Sizes, friction: float, rolling: float = 0.0, share: float = 1.0, density: float | None = None
) -> list[Component]:
    """Return an aggregate's spheres as parts of a bed in which it has a ``share`` of the solid volume [-]."""
    least = MIN_OF_RAREST if len(sizes) == 1 else MIN_OF_CLASS
    return [Component(diameter, friction, share * part, density, rolling, least) for diameter, part in sizes]


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
    """Return the periodic bed of a mixture, as large as the least width, height and counts ask for.

    Components of equal spheres become one species, and a single species the bed of equal spheres.
    Raises ShareError and SpecimenTooLarge.
    """
    check_shares([part.share for part in components])
    merged = _merge(components)
    if len(merged) == 1:
        return equal_spheres(merged[0].friction, seed, protocol, merged[0].rolling)
    per_volume = _per_volume(merged)
    least = MIN_WIDTH**2 * MIN_HEIGHT * DENSEST
    rarest = max(part.least / number for part, number in zip(merged, per_volume, strict=True))
    solids = max(least, rarest, EQUAL_SPHERES / sum(per_volume))
    width = on_grid(MIN_WIDTH * (solids / least) ** (1.0 / 3.0))
    return Specimen(_species(merged, solids), width, seed, protocol)


def in_cylinder(
    components: Sequence[Component], diameter: float, height: float, seed: int, protocol: Protocol
) -> Specimen:
    """Return the bed that fills a cylindrical measure to beyond its rim.

    ``diameter`` and ``height`` of the measure in the unit of the components' diameters; the settled fill
    is to stand 1.5 largest diameters above the rim. Raises ShareError, ProtocolError, SpecimenTooLarge.
    """
    check_shares([part.share for part in components])
    merged, largest = _merge(components), max(part.diameter for part in components)
    wide, high = on_grid(diameter / largest), on_grid(height / largest)
    if wide < NARROWEST or high < NARROWEST:
        raise ProtocolError(
            f"the measure is {wide:g} of the largest diameter wide and {high:g} high, less than {NARROWEST:g}; "
            "take a larger measure"
        )
    solids = math.pi / 4.0 * wide**2 * (high + FILL_ABOVE) * (DENSEST if len(merged) > 1 else DENSEST_EQUAL)
    return Specimen(_species(merged, solids), wide, seed, protocol, high)


def _per_volume(merged: Sequence[Component]) -> list[float]:
    """Return the spheres of each component in a unit of all solids' volume."""
    return [part.share / (math.pi / 6.0 * part.diameter**3) for part in merged]


def _species(merged: Sequence[Component], solids: float) -> tuple[Species, ...]:
    """Return the species whose solids have this volume. Raises SpecimenTooLarge."""
    counts = [math.ceil(solids * number) for number in _per_volume(merged)]
    if sum(counts) > MAX_SPHERES:
        raise SpecimenTooLarge(
            f"this takes {sum(counts):,} spheres, more than the cap of {MAX_SPHERES:,}: its size ratio is "
            f"{1.0 / merged[-1].diameter:.3g} and its smallest share {min(part.share for part in merged):.3g}; "
            "leave the finest aggregate out, raise the smallest share, or take a smaller measure"
        )
    return tuple(
        Species(part.diameter, part.friction, count, part.density or 1.0, part.rolling)
        for part, count in zip(merged, counts, strict=True)
    )


def _merge(components: Sequence[Component]) -> list[Component]:
    """Return the components in reduced units on the grid, coarse to fine, equal ones as one."""
    largest = max(part.diameter for part in components)
    known = [part.density for part in components if part.density is not None]
    alike = len(known) < len(components) or max(known) <= (1.0 + SAME_DENSITY) * min(known)
    heaviest = max((part.diameter, part.density or 0.0) for part in components)[1]
    merged: dict[tuple[float, float, float, float], tuple[float, int]] = {}
    for part in components:
        density = 1.0 if alike else on_grid((part.density or 0.0) / heaviest)
        key = (on_grid(part.diameter / largest), on_grid(part.friction), density, on_grid(part.rolling))
        share, least = merged.get(key, (0.0, 0))
        merged[key] = share + part.share, max(least, part.least)
    ordered = sorted(merged.items(), reverse=True)
    return [Component(d, mu, on_grid(share), density, mu_r, n) for (d, mu, density, mu_r), (share, n) in ordered]


def with_seeds(specimen: Specimen, seeds: Sequence[int]) -> list[Specimen]:
    """Return the same bed once for each seed."""
    return [replace(specimen, seed=seed) for seed in seeds]


def from_canonical(text: str) -> Specimen:
    """Return the specimen of a canonical form, as stored with its run; the wall's friction is then given.

    What an earlier engine's form does not name is as that engine had it, the default. Raises ProtocolError
    for a text that is no specimen of this version.
    """
    try:
        content = json.loads(text)
        return Specimen(
            tuple(Species(**kind) for kind in content["species"]), content["width"], content["seed"],
            Protocol(**content["protocol"]), content.get("height"),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise ProtocolError(
            f"'{text[:40]}' is no specimen of this version ({error!r}); use the pdlab that wrote it"
        ) from error
