"""Specimen → bed → packing density: the only room that calls the engine."""

import numpy as np

from pdlab import dem
from pdlab.dem import simulation
from pdlab.dem.jit import fingerprint
from pdlab.errors import RunDiverged, Segregated
from pdlab.specimen import Packing, Specimen

VERSION = dem.VERSION
SHARE_WARNING, SHARE_LIMIT = 0.02, 0.05
"""Differences between the slab's shares and the mixture's that are said, and that are refused."""

State = simulation.State


def setup(specimen: Specimen) -> simulation.Setup:
    """Return the engine's own form of a specimen."""
    protocol = specimen.protocol
    return simulation.Setup(
        diameter=np.array([kind.diameter for kind in specimen.species]),
        density=np.array([kind.density for kind in specimen.species]),
        friction=np.array([kind.friction for kind in specimen.species]),
        count=np.array([kind.count for kind in specimen.species]),
        width=specimen.width,
        seed=specimen.seed,
        wall_friction=specimen.wall_friction,
        restitution=protocol.restitution,
        local_damping=protocol.local_damping,
        nominal_overlap=protocol.nominal_overlap,
        cloud_fraction=protocol.cloud_fraction,
        steps_per_collision=protocol.steps_per_collision,
    )


def advance(specimen: Specimen, state: State | None, steps: int) -> State:
    """Return the bed after at most ``steps`` more steps, None standing for its beginning.

    Raises RunDiverged and NotAtRest.
    """
    return simulation.advance(setup(specimen), state, steps)


def measure(specimen: Specimen, state: State, seconds: float) -> Packing:
    """Return what a bed at rest shows; ``seconds``: computing time, kept with the result.

    Raises RunDiverged when spheres overlap too much, Segregated when the middle is another mixture.
    """
    low, high = simulation.slab(state.place)
    overlap = simulation.largest_overlap(setup(specimen), state)
    if overlap > simulation.MAX_OVERLAP:
        raise RunDiverged(
            f"two spheres overlap by {overlap:.2%} of the smaller diameter, more than the limit of "
            f"{simulation.MAX_OVERLAP:.0%}; lower the nominal overlap below {specimen.protocol.nominal_overlap:g}"
        )
    solids = np.bincount(state.species, simulation.solids_between(state.place, low, high), len(specimen.species))
    shares = tuple(float(share) for share in solids / solids.sum())
    return Packing(
        digest=specimen.digest(VERSION),
        packing_density=simulation.solid_fraction(state.place, specimen.width, low, high),
        coordination_number=simulation.contacts_per_sphere(state, low, high),
        height=2.0 * (high - low),
        slab_shares=shares,
        largest_overlap=overlap,
        rest=state.rest,
        steps=state.steps,
        seconds=seconds,
        engine_version=VERSION,
        warnings=_share_warnings(specimen, shares),
    )


def _share_warnings(specimen: Specimen, shares: tuple[float, ...]) -> tuple[str, ...]:
    off = max(abs(a - b) for a, b in zip(shares, specimen.shares, strict=True))
    if off > SHARE_LIMIT:
        raise Segregated(
            f"the middle of the bed is off the mixture's shares by {off:.3f}, more than the limit of "
            f"{SHARE_LIMIT:g}: the mixture segregates; choose proportions or sizes nearer to each other"
        )
    return (f"the middle of the bed is off the mixture's shares by {off:.3f}",) if off > SHARE_WARNING else ()


__all__ = ["VERSION", "State", "advance", "fingerprint", "measure", "setup"]
