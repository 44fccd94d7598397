"""Specimen → bed → packing density, or angle of repose: the only room that calls the engine."""

import math
from dataclasses import replace

import numpy as np

from pdlab import dem
from pdlab.dem import bed, deposition, heap, measures, profiles, saturation, simulation
from pdlab.dem.jit import fingerprint
from pdlab.errors import RunDiverged, Segregated, TooSoft
from pdlab.specimen import FILL_ABOVE, OWN, Packing, Specimen

VERSION = dem.VERSION
SHARE_WARNING, SHARE_LIMIT = 0.02, 0.05
"""Differences between the slab's shares and the mixture's that are said, and that are refused."""

LEAST_FOOT, LOPSIDED = 0.5, 2.0
"""Height in diameters below which a heap does not reach its base's edge; standard error, in degrees, that is said."""

PLACING = {"static": saturation.random_placement, "drop_and_roll": deposition.drop_and_roll}
"""The tests by geometry alone: what places the spheres of a bed."""

State = bed.State
Progress = simulation.Progress


def setup(specimen: Specimen) -> bed.Setup:
    """Return the engine's own form of a specimen."""
    protocol, kinds = specimen.protocol, specimen.species
    way = {name: getattr(protocol, name) for name in OWN[protocol.compaction]}
    if protocol.compaction != "vibrated":
        way["shake_periods"] = 0
    if protocol.compaction != "rodded":
        way |= {"layers": 1, "drops": 0}
    if protocol.compaction == "repose":
        way["lift_height"] = specimen.height
    return bed.Setup(
        diameter=np.array([kind.diameter for kind in kinds]),
        density=np.array([kind.density for kind in kinds]),
        friction=np.array([kind.friction for kind in kinds]),
        rolling=np.array([kind.rolling for kind in kinds]) if any(kind.rolling for kind in kinds) else None,
        count=np.array([kind.count for kind in kinds]),
        width=specimen.width,
        cylinder=protocol.container == "cylinder",
        seed=specimen.seed,
        wall_friction=specimen.wall_friction,
        restitution=protocol.restitution,
        local_damping=protocol.local_damping,
        moment_damping=protocol.moment_damping,
        nominal_overlap=protocol.nominal_overlap,
        cloud_fraction=protocol.cloud_fraction,
        steps_per_collision=protocol.steps_per_collision,
        pair_friction=protocol.pair_friction,
        **way,
    )


def advance(specimen: Specimen, state: State | None, steps: int, threads: int = 1) -> State:
    """Return the bed after at most ``steps`` more steps, None standing for its beginning.

    A bed by geometry alone is placed at once. ``threads`` share the work of each step: worth it for large beds on
    idle cores. Raises RunDiverged, NotAtRest, and InputError for more threads than cores.
    """
    if specimen.protocol.compaction in PLACING:
        return state or _placed(specimen)
    return simulation.advance(setup(specimen), state, steps, threads)


def _placed(specimen: Specimen) -> State:
    place, species = PLACING[specimen.protocol.compaction](setup(specimen))
    return replace(bed.rest_free(place, species), rest="placed")


def progress(specimen: Specimen, state: State) -> Progress:
    """Return how far a bed is."""
    return simulation.progress(setup(specimen), state)


def measure(specimen: Specimen, state: State, seconds: float) -> Packing:
    """Return what a bed at rest shows; ``seconds``: computing time, kept with the result.

    Raises TooSoft when spheres overlap too much, RunDiverged when a measure is not filled or a heap does not cover
    its base, Segregated when the middle is another mixture.
    """
    whole = setup(specimen)
    contacts = _contacts(specimen, whole, state)
    overlap = measures.largest_overlap(state.place, *contacts)
    _check_overlap(specimen, overlap)
    flank = _flank(specimen, whole, state) if specimen.protocol.compaction == "repose" else None
    rim = specimen.height if flank is None else None
    low, high = (0.0, rim) if rim is not None else measures.slab(state.place)
    solids = np.bincount(state.species, measures.solids_between(state.place, low, high), len(specimen.species))
    shares = tuple(float(share) for share in solids / solids.sum())
    middle = (low, high) if rim is None else (0.25 * rim, 0.75 * rim)
    return Packing(
        digest=specimen.digest(VERSION),
        packing_density=math.nan if flank is not None else _density(specimen, whole, state, low, high),
        coordination_number=measures.contacts_per_sphere(state.place, *contacts[:2], *middle),
        height=flank.top if flank is not None else rim or 2.0 * (high - low),
        slab_shares=shares,
        largest_overlap=overlap,
        rest=state.rest,
        steps=state.steps,
        seconds=seconds,
        engine_version=VERSION,
        warnings=(*_share_warnings(specimen, shares), *_flank_warnings(flank)),
        repose_angle_deg=flank.angle if flank is not None else None,
    )


def _contacts(specimen: Specimen, whole: bed.Setup, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the spheres i and j of every contact and its overlap, each of shape (K,)."""
    if specimen.protocol.compaction in PLACING:
        return profiles.touching(state.place, specimen.width, profiles.GAP)
    return measures.contacts(whole, state)


def _check_overlap(specimen: Specimen, overlap: float) -> None:
    if overlap <= measures.MAX_OVERLAP:
        return
    said = f"two spheres overlap by {overlap:.2%} of the smaller diameter, more than the limit of "
    said += f"{measures.MAX_OVERLAP:.0%}"
    if specimen.protocol.compaction in PLACING:
        raise RunDiverged(f"{said}, and none may; take another seed")
    raise TooSoft(
        f"{said}: contacts are too soft for spheres of such different sizes; choose sizes nearer to each other, or "
        f"lower the protocol's nominal overlap below {specimen.protocol.nominal_overlap:g}"
    )


def _density(specimen: Specimen, whole: bed.Setup, state: State, low: float, high: float) -> float:
    """Return the packing density between two planes. Raises RunDiverged when a measure is not filled."""
    density = measures.solid_fraction(state.place, whole.area, low, high)
    if specimen.height is not None:
        above = measures.solid_fraction(state.place, whole.area, high, high + 1e6) * 1e6 / density
        if above < FILL_ABOVE:
            raise RunDiverged(
                f"the fill stands {above:.2f} largest diameters above the rim, less than {FILL_ABOVE:g}; "
                "plan the measure with in_cylinder"
            )
    return density


def _flank(specimen: Specimen, whole: bed.Setup, state: State) -> heap.Flank:
    """Return a heap's flank. Raises RunDiverged when it does not cover its base, or stands in the lifted cylinder."""
    place = state.place - 0.5 * whole.box * np.array([1.0, 1.0, 0.0, 0.0])
    flank = heap.flank(place, 0.5 * specimen.protocol.base_diameter)
    if flank.foot < LEAST_FOOT:
        raise RunDiverged(
            f"the heap is {flank.foot:.2f} largest diameters high at the edge of its base, less than {LEAST_FOOT:g}; "
            "pour more spheres"
        )
    if flank.top > whole.lift_height:
        raise RunDiverged(
            f"the heap stands {flank.top:.1f} largest diameters high, in the cylinder that was lifted by "
            f"{whole.lift_height:g}; lift it higher"
        )
    return flank


def _flank_warnings(flank: heap.Flank | None) -> tuple[str, ...]:
    if flank is None or flank.standard_error <= LOPSIDED:
        return ()
    return (f"the heap is lopsided: its sectors' angle is {flank.angle:.1f} ± {flank.standard_error:.1f} degrees",)


def _share_warnings(specimen: Specimen, shares: tuple[float, ...]) -> tuple[str, ...]:
    off = max(abs(a - b) for a, b in zip(shares, specimen.shares, strict=True))
    if off > SHARE_LIMIT:
        raise Segregated(
            f"the simulated mixture segregates: in the middle of the bed, where PD is measured, a share is {off:.3f} "
            f"off the mixture's, more than {SHARE_LIMIT:g}; choose proportions or sizes nearer to each other"
        )
    if off <= SHARE_WARNING:
        return ()
    return (
        f"the simulated mixture segregates a little: in the middle of the bed, where PD is measured, a share is "
        f"{off:.3f} off the mixture's ({SHARE_LIMIT:g} would be too much)",
    )


__all__ = ["VERSION", "Progress", "State", "advance", "fingerprint", "measure", "progress", "setup"]
