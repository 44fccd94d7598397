"""Gradings of several aggregates → the grading of their mixture."""

import math
from collections.abc import Sequence

import numpy as np

from pdlab.errors import GradingError
from pdlab.grading.sieving import Grading, passing_at

ROUNDING = 1e-9
"""How far the shares of a mixture may sum off 1."""


def combined(gradings: Sequence[Grading], shares: Sequence[float]) -> Grading:
    """Return the grading of a mixture: of what passes an aperture, the mean of its parts by solid volume.

    ``shares`` of the solid volume [-], one for each part, their sum 1. The apertures are those of all parts; between
    its own, what passes of a part is interpolated over their logarithm. Raises GradingError.
    """
    if not gradings or len(gradings) != len(shares):
        raise GradingError(f"{len(shares)} shares for {len(gradings)} gradings; give one share for each")
    if min(shares) <= 0.0 or abs(math.fsum(shares) - 1.0) > ROUNDING:
        raise GradingError(f"the shares {', '.join(f'{one:g}' for one in shares)} are not positive with a sum of 1")
    apertures = sorted({aperture for one in gradings for aperture in one.apertures}, reverse=True)
    passing = [
        math.fsum(share * passing_at(one, aperture) for one, share in zip(gradings, shares, strict=True))
        for aperture in apertures
    ]
    finest = min(one.apertures[one.sieves - 1] for one in gradings)
    sieves = sum(aperture >= finest for aperture in apertures)
    return Grading(tuple(apertures), tuple(float(share) for share in -np.diff(passing)), sieves)
