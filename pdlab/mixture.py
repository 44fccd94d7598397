"""Proportions → specimens → prediction. This module runs nothing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pdlab.errors import ProtocolError
from pdlab.specimen import (
    EQUAL_SPHERES,
    LOOSE,
    Packing,
    Protocol,
    Sizes,
    Specimen,
    components,
    mixed_spheres,
    with_seeds,
)

SEEDS, MAX_SEEDS, SEED_STEP = 4, 16, 2
STANDARD_ERROR = 0.003
"""Standard error over seeds at which no more are run."""
SCATTER, SCATTER_LEAST = 0.0028, 0.0018
"""Standard deviation of PD over seeds: of a bed of 2500 equal spheres, and what is left of it where very many bear."""
STIFFER, STIFFEST = 2.0, 8.0
"""Factor by which contacts are made stiffer where fine spheres bear what coarse ones weigh, and its most."""


@dataclass(frozen=True)
class Part:
    """An aggregate in a mixture: its ``share`` of the solid volume and what calibration says of it.

    ``sizes``: the diameters [mm] of its spheres with their shares [-]; ``friction``, ``rolling`` [-];
    ``packing_density`` measured, alone [-], NaN where nothing is calibrated; ``input_error`` and ``curve_error`` of
    its calibration, in PD [-]; ``protocol``: how its test was simulated; ``density``: oven-dry particle density
    [kg/m³].
    """

    aggregate: str
    share: float
    sizes: Sizes
    friction: float = 0.0
    packing_density: float = math.nan
    input_error: float = 0.0
    curve_error: float = 0.0
    protocol: Protocol = LOOSE
    density: float | None = None
    rolling: float = 0.0


@dataclass(frozen=True)
class Predicted:
    """A mixture's packing density [-] and its errors in PD [-].

    ``standard_error``: of the simulation, seeds and curves. ``input_error``: of the measured PDs.
    """

    packing_density: float
    standard_error: float
    input_error: float
    seeds: int
    warnings: tuple[str, ...]


def common_protocol(parts: Sequence[Part]) -> Protocol:
    """Return the protocol that all parts were calibrated in, with the smallest wall friction that any of them has.

    Where none has one, walls have the smallest friction of the spheres. Raises ProtocolError when their density tests
    were compacted, or simulated, in different ways.
    """
    walls = [part.protocol.wall_friction for part in parts if part.protocol.wall_friction is not None]
    wall = min(walls, default=None)
    ways = dict.fromkeys(replace(part.protocol, wall_friction=wall) for part in parts)
    if len({way.compaction for way in ways}) > 1:
        raise ProtocolError(
            f"the aggregates' newest density tests are {' and '.join(sorted({way.compaction for way in ways}))}; a "
            "mixture needs one compaction: enter a newer test of the same kind, with its date"
        )
    if len(ways) > 1:
        settings = [way.settings() for way in ways]
        differing = sorted(name for name in settings[0] if len({str(one.get(name)) for one in settings}) > 1)
        raise ProtocolError(
            f"the aggregates were calibrated under different protocols ({', '.join(differing)} differ); a friction "
            "coefficient belongs to its protocol: calibrate them anew under one"
        )
    return next(iter(ways), LOOSE)


def stiffened(protocol: Protocol, times: float) -> Protocol:
    """Return a protocol with contacts so many times as stiff."""
    return replace(protocol, nominal_overlap=protocol.nominal_overlap / times)


def next_specimens(
    parts: Sequence[Part],
    done: Sequence[Packing],
    seeds: int = SEEDS,
    wished_error: float = STANDARD_ERROR,
    stiffer: float = 1.0,
) -> list[Specimen]:
    """Return the beds to run next: ``seeds`` at first, then two more until ``wished_error`` [-] is met.

    ``stiffer``: how many times as stiff as in the calibrations the contacts are. Never more than the larger
    of ``seeds`` and 16. Raises ProtocolError, ShareError, SpecimenTooLarge.
    """
    protocol = stiffened(common_protocol(parts), stiffer)
    if len(done) < seeds:
        wanted = seeds
    elif seed_error(done) > wished_error and len(done) < MAX_SEEDS:
        wanted = min(len(done) + SEED_STEP, MAX_SEEDS)
    else:
        return []
    spheres = [
        one for part in parts for one in components(part.sizes, part.friction, part.rolling, part.share, part.density)
    ]
    return with_seeds(mixed_spheres(spheres, 1, protocol), range(len(done) + 1, wanted + 1))


def seed_error(packings: Sequence[Packing]) -> float:
    """Return the standard error of the mean PD over seeds; infinite for one."""
    values = np.array([packing.packing_density for packing in packings])
    return float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.inf


def scatter(parts: Sequence[Part], bed: Specimen, packing_density: float) -> float:
    """Return the standard deviation over seeds that the PD [-] of a mixture's bed is expected to have.

    That of equal spheres, as many as the bed has of the aggregate that bears, carried as in ``sensitivities``. By
    Furnas that aggregate bears whose bulk volume with the solids of the coarser ones is the largest.
    """
    ordered = sorted(parts, key=lambda part: -max(size for size, _ in part.sizes))
    coarser, bearing, volume = 0.0, ordered[0], 0.0
    for part in ordered:
        bulk = coarser + part.share / part.packing_density
        coarser += part.share
        if bulk > volume:
            bearing, volume = part, bulk
    largest = max(size for size, _ in ordered[0].sizes)
    solids = math.fsum(kind.count * kind.diameter**3 for kind in bed.species)
    spheres = solids * bearing.share * math.fsum(share * (largest / size) ** 3 for size, share in bearing.sizes)
    carried = bearing.share * (packing_density / bearing.packing_density) ** 2
    falling = (SCATTER**2 - SCATTER_LEAST**2) * EQUAL_SPHERES / spheres
    return math.sqrt(carried**2 * falling + SCATTER_LEAST**2)


def sensitivities(parts: Sequence[Part], packing_density: float) -> np.ndarray:
    """Return ∂PD/∂PD_i of the mixture, shape (S,), for carrying the parts' errors.

    Of specific volumes that add up, 1/PD = Σ y_i/PD_i: y_i (PD/PD_i)². It carries errors, nothing else.
    """
    shares, alone = (np.array(column) for column in zip(*((p.share, p.packing_density) for p in parts), strict=True))
    return np.asarray(shares * (packing_density / alone) ** 2)


def uncalibrated(packings: Sequence[Packing]) -> Predicted:
    """Return what the runs of a mixture's bed say, one for each seed, into which no calibration's error enters."""
    mean = float(np.mean([packing.packing_density for packing in packings]))
    warnings = dict.fromkeys(text for packing in packings for text in packing.warnings)
    return Predicted(mean, seed_error(packings), 0.0, len(packings), tuple(warnings))


def predict(parts: Sequence[Part], packings: Sequence[Packing], stiffer: float = 1.0) -> Predicted:
    """Return the prediction from the runs of a mixture's bed, one for each seed.

    ``stiffer``: how many times as stiff as in the calibrations the contacts were.
    """
    plain = uncalibrated(packings)
    weight, warnings = sensitivities(parts, plain.packing_density), plain.warnings
    # the parts' curves share runs, so that their errors add up
    curve_error = math.fsum(weight * [part.curve_error for part in parts])
    if stiffer > 1.0:
        warnings += (
            f"contacts are {stiffer:g} times as stiff as in the calibrations, since fine spheres bear what coarse ones "
            f"weigh; that lowers PD by some {0.001 * math.log2(stiffer):.3f} to {0.002 * math.log2(stiffer):.3f}",
        )
    return replace(
        plain,
        standard_error=math.hypot(plain.standard_error, curve_error),
        input_error=float(np.linalg.norm(weight * [part.input_error for part in parts])),
        warnings=warnings,
    )
