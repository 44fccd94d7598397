"""What spheres reach when they are laid in order: lattices of equal spheres, and sizes that fill each other's voids.

References to read predictions against: no poured bed is ordered.
"""

import math
from collections.abc import Sequence
from itertools import accumulate

from pdlab.specimen import check_shares

LATTICES = {
    "sc": math.pi / 6.0,
    "bcc": math.pi * math.sqrt(3.0) / 8.0,
    "fcc": math.pi / math.sqrt(18.0),
    "hcp": math.pi / math.sqrt(18.0),
}
"""Packing densities of the lattices of equal spheres: simple and body-centred cubic, face-centred cubic and
hexagonal close packing. Equal spheres lie no denser than the last two (Hales 2005)."""


def nested(shares: Sequence[float], packing_density: float = LATTICES["fcc"]) -> float:
    """Return the packing density [-] of sizes of which each fills the voids of all coarser ones.

    ``shares`` of the solid volume, coarse to fine, one for each size. ``packing_density`` of each size alone. The
    size ratios are infinite: a finer size finds all voids of the coarser ones and loses nothing at their surfaces,
    a coarser one lies in a finer one's mass as a solid. Size i, whose share is y_i and whose density alone is φ,
    needs the volume y_i/φ beside the solids of the coarser ones, so that 1/PD is the largest of
    Σ_(j<i) y_j + y_i/φ: for two sizes the two lines of Furnas (1931). Raises ShareError.
    """
    check_shares(shares)
    coarser = accumulate(shares, initial=0.0)
    needed = max(solid + share / packing_density for solid, share in zip(coarser, shares, strict=False))
    return math.fsum(shares) / needed
