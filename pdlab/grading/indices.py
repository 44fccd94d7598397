"""What gradings are called by: the sizes that a share passes, the coefficient of uniformity, the fineness modulus."""

import math

import numpy as np

from pdlab.errors import GradingError
from pdlab.grading.sieving import Grading, passing_at

FINENESS = {
    "ASTM C136": (150.0, 75.0, 37.5, 19.0, 9.5, 4.75, 2.36, 1.18, 0.6, 0.3, 0.15),
    "EN 12620": (4.0, 2.0, 1.0, 0.5, 0.25, 0.125),
}
"""Sieves [mm] of the fineness modulus: ASTM C136/C136M, calculation; EN 12620:2002+A1:2008, annex B, note."""


def size_at(grading: Grading, share: float) -> float:
    """Return the size [mm] that a ``share`` [-] of the solids passes, D10 at 0.1, interpolated over its logarithm."""
    rising, log_aperture = grading.passing[::-1], np.log(grading.apertures)[::-1]
    return math.exp(float(np.interp(share, rising, log_aperture)))


def uniformity(grading: Grading) -> float:
    """Return the coefficient of uniformity D60/D10 [-] (Hazen 1892; ASTM D2487)."""
    return size_at(grading, 0.6) / size_at(grading, 0.1)


def fineness_modulus(grading: Grading, standard: str = "ASTM C136") -> float:
    """Return the sum of the percents retained on the standard's sieves and on all coarser ones, over 100 [-].

    What is retained on a sieve that the grading lacks is interpolated over the logarithm of its aperture.
    Raises GradingError for a standard that is none of ``FINENESS``.
    """
    if standard not in FINENESS:
        raise GradingError(f"'{standard}' has no fineness modulus here; use one of {', '.join(FINENESS)}")
    return math.fsum(1.0 - passing_at(grading, aperture) for aperture in FINENESS[standard])


def interpolated_sieves(grading: Grading, standard: str = "ASTM C136") -> tuple[float, ...]:
    """Return the sieves [mm] of a fineness modulus within the grading that its sieve table lacks."""
    coarsest, finest = grading.apertures[0], grading.apertures[-1]
    sieved = grading.apertures[: grading.sieves]
    return tuple(aperture for aperture in FINENESS[standard] if finest < aperture < coarsest and aperture not in sieved)


def retained_percents(grading: Grading) -> tuple[float, ...]:
    """Return the percent of the solids retained on each aperture but not on the coarser ones, shape (K + 1,)."""
    return (0.0, *(100.0 * share for share in grading.shares))


def indices(grading: Grading) -> dict[str, float]:
    """Return D10, D50, D60 [mm], the coefficient of uniformity and the fineness moduli by the names of quantities."""
    sizes = {f"d{share}": size_at(grading, share / 100.0) for share in (10, 50, 60)}
    moduli = {f"fineness_{standard.split()[0].lower()}": fineness_modulus(grading, standard) for standard in FINENESS}
    return sizes | {"uniformity": uniformity(grading)} | moduli
