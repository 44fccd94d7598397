"""Methods against measurements: bias and errors with bootstrap intervals, leave-one-out for what is fitted.

Differences are predicted minus measured packing densities, against the measured values as they are: a method
without any error of its own would show that of the measurements.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import bootstrap, kurtosis, norm, skew

from pdlab.errors import InputError, OutOfReach, TooFewData
from pdlab.theory import MIN_DATA, MOVED, Floats, Material, cpm, log_index_range

CONFIDENCE, SEED, RESAMPLES = 0.95, 1, 9999
LEAST, FEW = 3, 10
"""Mixtures from which on an interval is told, and below which it is too narrow: of normal differences it holds the
true value in some 0.7 instead of 0.95 of all cases at 3 mixtures, 0.8 at 5, 0.9 at 10."""
MANY, SKEWED = 100, 0.5
"""Values from which on the ends are worked out instead of drawn, and the skewness of their mean up to which that
holds: to 0.03 standard errors, as much as one seed's resamples differ from another's (tests/test_comparison.py)."""
DRAWN, KEPT = 1_000_000, 64
"""Values that are drawn at once, and samples whose resamples are remembered."""
EQUAL = 1e-12
"""Relative spread below which values are equal but for rounding."""
INDICES = 600
"""Compaction indices among which the best is looked for, a hundredth apart in their logarithm."""


@dataclass(frozen=True)
class Figure:
    """A figure in PD [-] with the ends of its interval, or why it has none."""

    value: float
    low: float | None = None
    high: float | None = None
    no_interval: str = ""


@dataclass(frozen=True)
class Errors:
    """What a method's differences from the measured packing densities come to.

    ``bias``: their mean; ``mean_absolute``, ``root_mean_square``; ``largest``: the difference that is largest either
    way, without an interval, since no resample holds a larger one; ``where``: its place.
    """

    mixtures: int
    bias: Figure
    mean_absolute: Figure
    root_mean_square: Figure
    largest: float
    where: int


def errors_of(differences: ArrayLike, confidence: float = CONFIDENCE, seed: int = SEED) -> Errors:
    """Return bias, mean absolute and root mean square error of differences [-], shape (M,), with their intervals.

    ``confidence`` of the intervals [-]; ``seed`` of the resamples. Raises TooFewData without any difference,
    InputError for a confidence outside (0, 1).
    """
    off = np.asarray(differences, dtype=np.float64)
    if not off.size:
        raise TooFewData("no mixture is both measured and predicted; measure one, or run 'pdlab predict'")
    where = int(np.argmax(np.abs(off)))
    return Errors(
        mixtures=off.size,
        bias=mean_with_interval(off, confidence, seed),
        mean_absolute=mean_with_interval(np.abs(off), confidence, seed),
        root_mean_square=_root(mean_with_interval(off**2, confidence, seed)),
        largest=float(off[where]),
        where=where,
    )


def _root(figure: Figure) -> Figure:
    low, high = (None if end is None else math.sqrt(end) for end in (figure.low, figure.high))
    return Figure(math.sqrt(figure.value), low, high, figure.no_interval)


def gain_over(differences: ArrayLike, reference: ArrayLike, confidence: float = CONFIDENCE, seed: int = SEED) -> Figure:
    """Return by how much a method's mean absolute error lies above a reference's, of the same mixtures, shape (M,).

    Below zero the method is better; pairs are resampled, so that what both share cancels. Raises as ``errors_of``.
    """
    return mean_with_interval(np.abs(differences) - np.abs(reference), confidence, seed)


def mean_with_interval(values: ArrayLike, confidence: float = CONFIDENCE, seed: int = SEED) -> Figure:
    """Return the mean of values, shape (M,), with its bootstrap interval by percentiles.

    Fewer than three values, or equal ones, have none; that of fewer than ten is too narrow. The resamples of a seed
    are the same for every method. From a hundred values on the percentiles of all resamples are worked out from the
    sample's moments, unless single values outweigh the others. Raises InputError.
    """
    sample = np.asarray(values, dtype=np.float64)
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence {confidence:g} must lie between 0 and 1; give 0.95, say")
    mean = float(sample.mean())
    if sample.size < LEAST:
        said = "1 mixture says" if sample.size == 1 else f"{sample.size} mixtures say"
        return Figure(mean, no_interval=f"{said} nothing of an interval, it takes {LEAST}")
    if np.ptp(sample) <= EQUAL * float(np.abs(sample).max()):
        return Figure(mean, no_interval=f"all {sample.size} mixtures give the same value")
    low, high = _expanded(sample, confidence) or _resampled(sample.tobytes(), confidence, seed)
    return Figure(mean, low, high)


def _expanded(sample: Floats, confidence: float) -> tuple[float, float] | None:
    """Return the percentiles of the mean of resamples by its cumulants, None where these do not tell them well enough.

    The mean of M draws with replacement has the sample's cumulants over M^(k-1). Source: Cornish and Fisher (1938),
    the expansion to the fourth cumulant; Hall (1992), The Bootstrap and Edgeworth Expansion, section 2.5.
    """
    skewness, excess = float(skew(sample)) / math.sqrt(sample.size), float(kurtosis(sample)) / sample.size
    if sample.size < MANY or abs(skewness) > SKEWED:
        return None
    z = norm.ppf(np.array([0.5 - confidence / 2.0, 0.5 + confidence / 2.0]))
    w = z + (z**2 - 1.0) * skewness / 6.0 + (z**3 - 3.0 * z) * excess / 24.0 - (2.0 * z**3 - 5.0 * z) * skewness**2 / 36
    low, high = (sample.mean() + w * sample.std() / math.sqrt(sample.size)).tolist()
    inside = sample.min() < low < high < sample.max()  # no resample's mean lies outside
    return (low, high) if inside else None


@functools.lru_cache(KEPT)
def _resampled(sample: bytes, confidence: float, seed: int) -> tuple[float, float]:
    """Return the percentiles of the mean of resamples that are drawn."""
    values = np.frombuffer(sample)
    found = bootstrap(
        (values,), np.mean, confidence_level=confidence, n_resamples=RESAMPLES, method="percentile",
        rng=np.random.default_rng(seed), batch=max(1, DRAWN // values.size),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)


def best_constant(measured: ArrayLike) -> Floats:
    """Return for each mixture the mean of the others' measured packing densities [-], shape (M,).

    Raises TooFewData for fewer than two mixtures.
    """
    values = np.asarray(measured, dtype=np.float64)
    if values.size < 2:
        raise TooFewData(f"the mean of the others takes 2 measured mixtures, here {values.size}; measure more")
    return np.asarray((values.sum() - values) / (values.size - 1), dtype=np.float64)


@dataclass(frozen=True)
class LeftOut:
    """A mixture's packing density [-] by the compressible packing model at the index K fitted to the others [-]."""

    packing_density: float
    index: float


def fitted_to_the_others(
    materials: Sequence[Material], shares: ArrayLike, measured: ArrayLike
) -> list[LeftOut | InputError]:
    """Return each mixture's packing density at the compaction index that fits the others best, or why there is none.

    ``shares`` of the solid volume, shape (M, S); ``measured`` packing densities [-], shape (M,). As
    ``theory.fit_compaction_index`` without that mixture: aggregates and mixtures are taken as compacted alike. The
    best K lies on the parabola through the best of a grid and its neighbours, exact to 1e-5 in PD. Raises
    DensityError, ShareError.
    """
    alike = [replace(material, compaction=None) for material in materials]
    target = np.asarray(measured, dtype=np.float64)
    grid = np.linspace(*log_index_range(alike), INDICES)
    values = np.array([cpm(alike, shares, math.exp(point)) for point in grid])
    depends = np.abs(values[-1] - values[0]) > MOVED
    squares = (values - target) ** 2
    left = squares.sum(axis=1, keepdims=True) - squares
    out = list[LeftOut | InputError]()
    for k, best in enumerate(left.argmin(axis=0).tolist()):
        others = int(depends.sum() - depends[k])
        if others < MIN_DATA:
            text = f"{others} other mixtures depend on the compaction index K, it takes {MIN_DATA}; measure more"
            out.append(TooFewData(text))
        elif best in (0, INDICES - 1):
            at = f"the best K of the other mixtures lies at an end of its range, {math.exp(grid[best]):.3g}"
            out.append(OutOfReach(f"{at}; check their tests, or take K by the compaction"))
        else:
            around = slice(best - 1, best + 2)
            off = _vertex(left[around, k])
            index = math.exp(grid[best] + off * (grid[1] - grid[0]))
            out.append(LeftOut(float(cpm(alike, np.asarray(shares)[[k]], index)[0]), index))
    return out


def _vertex(three: Floats) -> float:
    """Return where the parabola through three equidistant points is least, in steps from the middle one."""
    bend = three[0] - 2.0 * three[1] + three[2]
    return float((three[0] - three[2]) / (2.0 * bend)) if bend > 0.0 else 0.0
