"""Analytical packing models: a mixture's packing density from what is known of each aggregate alone.

They stand beside the simulation and take the same inputs; functions of arrays, all mixtures at once.
Volumes are per unit of solid volume, so that a packing density is one over a bulk volume.

Furnas and Toufar see an aggregate as one size with its packing density. More than two are combined from
the finest up, two at a time: what is combined so far is the fine aggregate of the next step, with its
combined packing density and its log-mean diameter by solid volume. That is a choice of this project.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from pdlab.errors import DensityError, GradingError, InputError, OutOfReach, ProtocolError, ShareError, TooFewData
from pdlab.grading import LARGEST, SMALLEST
from pdlab.specimen import SHARE_TOLERANCE

Floats = NDArray[np.float64]

COMPACTION_INDEX = {
    "loose": 4.1,
    "rodded": 4.5,
    "vibrated": 4.75,
    "vibrated_under_pressure": 9.0,
    "unstated": 4.1,  # as it is simulated
}
"""De Larrard's index K of a packing process, from memory of de Larrard 1999, table of values of K."""
X0, K0 = 0.4753, 0.3881
"""Goltermann et al. 1997: the filling factor of Toufar's model is linear up to (x0, k0), from memory."""
LOOSEST = 1e-3
"""Packing density below which an entry is a typing error."""
SAME_SIZE = 1e-9
"""Relative difference of diameters that is rounding: such aggregates are of one size."""
NEGLIGIBLE = 1e-12
"""Share of the solid volume that is rounding and taken as none."""
MIN_DATA = 2
"""Mixtures that a fitted compaction index needs."""
LARGEST_INDEX = 1e3
MOVED = 1e-6
"""Change in PD over the range of the compaction index below which a mixture says nothing about it."""


@dataclass(frozen=True)
class Material:
    """What the theories know of an aggregate; raises GradingError, DensityError, ProtocolError.

    ``diameter``: equivalent, by a rule [mm]. ``packing_density``: measured, alone [-]. ``sizes`` [mm] and
    ``shares`` [-] of its sieve classes, shape (K,), for the compressible packing model; without them one
    class of the diameter. ``compaction`` of its density test; None: packed as its mixtures are.
    """

    diameter: float
    packing_density: float
    sizes: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()
    compaction: str | None = None

    def __post_init__(self) -> None:
        if not self.sizes and not self.shares:
            object.__setattr__(self, "sizes", (self.diameter,))
            object.__setattr__(self, "shares", (1.0,))
        if len(self.sizes) != len(self.shares):
            raise GradingError(f"{len(self.sizes)} sizes and {len(self.shares)} shares of classes; give one of each")
        for size in (self.diameter, *self.sizes):
            if not SMALLEST <= size <= LARGEST:
                raise GradingError(f"size {size:g} mm must lie between {SMALLEST:g} and {LARGEST:g}; correct it")
        for share in self.shares:
            if not 0.0 <= share <= 1.0 + NEGLIGIBLE:
                raise GradingError(f"share {share:g} of a class lies outside [0, 1]; correct it")
        if abs(math.fsum(self.shares) - 1.0) > SHARE_TOLERANCE:
            raise GradingError(f"the classes' shares sum to {math.fsum(self.shares):.6g}, not to 1; correct them")
        if not LOOSEST <= self.packing_density < 1.0:
            raise DensityError(
                f"packing density {self.packing_density:g} must lie between {LOOSEST:g} and 1; check it and its unit"
            )
        if self.compaction is not None:
            compaction_index(self.compaction)


def compaction_index(compaction: str) -> float:
    """Return de Larrard's compaction index K [-] of a way to compact. Raises ProtocolError.

    Source: de Larrard, Concrete Mixture Proportioning, 1999; values from memory. ``unstated`` is taken as loose.
    """
    if compaction not in COMPACTION_INDEX:
        raise ProtocolError(f"compaction '{compaction}' has no index K; use one of {', '.join(COMPACTION_INDEX)}")
    return COMPACTION_INDEX[compaction]


def volume_mean(materials: Sequence[Material], shares: ArrayLike, compaction: str | None = None) -> Floats:
    """Return the mean of the aggregates' packing densities by solid volume, shape (M,): a reference, no theory.

    ``shares`` of the solid volume, shape (M, S). Raises ShareError, ProtocolError.
    """
    part = _checked(materials, shares)
    check_compaction("volume_mean", materials, compaction)
    return np.asarray(part @ [material.packing_density for material in materials], dtype=np.float64)


def furnas(materials: Sequence[Material], shares: ArrayLike, compaction: str | None = None) -> Floats:
    """Return the packing densities of mixtures at infinite size ratios, shape (M,): an upper bound.

    ``shares`` of the solid volume, shape (M, S). A coarse aggregate either holds all that is finer in its
    voids or floats in it: min(φ_c/(1 − y_f), 1/(y_c + y_f/φ_f)), step by step from the finest. Only the order
    of the sizes counts; equal sizes are one aggregate. Raises ShareError, ProtocolError.

    Source: C. C. Furnas, Ind. Eng. Chem. 23 (1931) 1052; the optimum of two sizes was read there, the
    formula for any proportion is from memory.
    """
    part = _checked(materials, shares)
    check_compaction("furnas", materials, compaction)
    volume = np.zeros(len(part))
    for _, solid, bulk in _by_size(materials, part):
        volume = np.maximum(bulk, solid + volume)
    return 1.0 / volume


def toufar(materials: Sequence[Material], shares: ArrayLike, compaction: str | None = None) -> Floats:
    """Return the packing densities of mixtures by Toufar's model as Goltermann et al. corrected it, shape (M,).

    ``shares`` of the solid volume, shape (M, S). Of the voids r2 (1/φ2 − 1) among the coarse grains the fine
    aggregate fills k_d k_s: 1/φ = r1/φ1 + r2/φ2 − r2 (1/φ2 − 1) k_d k_s, k_d = (d2 − d1)/(d1 + d2), 1 fine,
    2 coarse. Raises ShareError, ProtocolError.

    Source: Toufar, Born and Klose 1976; Goltermann, Johansen and Palbøl, ACI Materials Journal 94 (1997) 435,
    both from memory.
    """
    part = _checked(materials, shares)
    check_compaction("toufar", materials, compaction)
    fine, volume, log_sum = np.zeros(len(part)), np.zeros(len(part)), np.zeros(len(part))
    for diameter, solid, bulk in _by_size(materials, part):
        present = fine > 0.0
        fine_diameter = np.exp(np.divide(log_sum, fine, out=np.full_like(fine, math.log(diameter)), where=present))
        size_factor = (diameter - fine_diameter) / (diameter + fine_diameter)
        voids = bulk - solid
        volume = volume + bulk - voids * size_factor * _filling(volume, voids)
        fine, log_sum = fine + solid, log_sum + solid * math.log(diameter)
    return 1.0 / volume


def _filling(fine: Floats, voids: Floats) -> Floats:
    """Return Toufar's factor k_s [-] of x, the ``fine`` aggregate's bulk volume over the coarse one's ``voids``.

    k_s = 1 − (1 + 4x)/(1 + x)⁴, below x0 linear after Goltermann et al.; the two differ by 0.0005 at x0.
    """
    x = np.divide(fine, voids, out=np.full_like(fine, np.inf), where=voids > 0.0)
    s = 1.0 / (1.0 + x)
    return np.where(x < X0, K0 * np.minimum(x, X0) / X0, 1.0 - s**3 * (4.0 - 3.0 * s))


def cpm(materials: Sequence[Material], shares: ArrayLike, compaction: str | float = "unstated") -> Floats:
    """Return the packing densities of mixtures by the compressible packing model, shape (M,).

    ``shares`` of the solid volume, shape (M, S); ``compaction`` of the mixtures, by name or as its index K [-].
    Every sieve class of every aggregate is a class. The packing density φ solves
    K = Σ (y_i/β_i)/(1/φ − 1/γ_i), where γ_i is the virtual packing density when class i is dominant and β_i the
    residual one, see ``residual_packing``. Raises ShareError, DensityError, ProtocolError.

    Source: de Larrard, Concrete Mixture Proportioning, 1999. The equations are from memory; of two public
    programs that have the same γ_i one cites the book, one has the formula of K too; the book was not read.
    """
    part = _checked(materials, shares)
    index = _index_of(compaction)
    sizes, solid = _by_class_size(materials)
    bulk = solid / _residual_packings(materials, index)[:, None]
    at_bulk, at_solid = _interaction(sizes)
    weights = part @ bulk
    virtual = weights @ at_bulk.T + (part @ solid) @ at_solid.T  # 1/γ_i
    return 1.0 / _compacted(weights, virtual, index)


def _by_class_size(materials: Sequence[Material]) -> tuple[Floats, Floats]:
    """Return the sizes [mm] of all classes, each once, shape (D,), and each aggregate's shares of them, (S, D)."""
    # what classes of one size take depends on their sum only, and aggregates share sieves
    sizes, place = np.unique(np.concatenate([material.sizes for material in materials]), return_inverse=True)
    owner = np.repeat(np.arange(len(materials)), [len(material.sizes) for material in materials])
    solid = np.zeros((len(materials), sizes.size))
    np.add.at(solid, (owner, place), np.concatenate([_portions(material) for material in materials]))
    return sizes, solid


@lru_cache(maxsize=4096)
def residual_packing(material: Material, index: float) -> float:
    """Return the residual packing density β [-] of an aggregate's classes, one for all of them.

    It is the one at which the compressible packing model gives the measured packing density of the aggregate
    alone, at the compaction index of its own test, or at ``index`` [-] where it has none: of one class
    β = φ (1 + 1/K). There always is exactly one; raises DensityError when it is not below 1.

    Source: as ``cpm``.
    """
    return float(_residual_packings([material], index)[0])


def _residual_packings(materials: Sequence[Material], index: float) -> Floats:
    """Return the residual packing density β [-] of each aggregate, shape (S,), see ``residual_packing``."""
    own = np.array([index if m.compaction is None else compaction_index(m.compaction) for m in materials])
    terms = [_residual_terms(material) for material in materials]
    weights, poles = np.zeros((2, len(terms), max(len(weight) for weight, _ in terms)))
    for k, (weight, pole) in enumerate(terms):
        weights[k, : weight.size], poles[k, : pole.size] = weight, pole
    beta = _compacted(weights, poles, own[:, None])
    for k in map(int, np.flatnonzero(~(beta < 1.0))):
        raise DensityError(
            f"packing density {materials[k].packing_density:g} of the aggregate of {materials[k].diameter:g} mm needs "
            f"a residual packing density of {beta[k]:.4g} at K = {own[k]:g}, which must be below 1; check its test and "
            f"compaction (K above {_least_index(materials[k]):.4g} would do)"
        )
    return beta


def _least_index(material: Material) -> float:
    """Return the compaction index [-] above which the residual packing density is below 1."""
    weights, poles = _residual_terms(material)
    return float(np.sum(weights / (1.0 - poles)))


@lru_cache(maxsize=1024)
def _residual_terms(material: Material) -> tuple[Floats, Floats]:
    """Return C and G, shape (K,), of Σ C_k/(β − G_k) = K, the model of one aggregate solved for 1/β.

    1/γ_k is p_k/β + r_k, so that w_k/β/(1/φ − 1/γ_k) is (w_k/α_k)/(β − p_k/α_k), α_k = 1/φ − r_k.
    """
    bulk, solid = _interaction(np.array(material.sizes))
    share = _portions(material)
    room = 1.0 / material.packing_density - solid @ share
    return share / room, (bulk @ share) / room


def _portions(material: Material) -> Floats:
    """Return the shares of an aggregate's classes as parts of their sum, shape (K,)."""
    shares = np.array(material.shares)
    shares[shares < NEGLIGIBLE] = 0.0
    return np.asarray(shares / shares.sum(), dtype=np.float64)


def _interaction(sizes: Floats) -> tuple[Floats, Floats]:
    """Return what a class j takes where class i is dominant, shape (K, K): parts at bulk and at solid volume.

    ``sizes`` [mm], shape (K,). In these terms 1/γ_i = Σ_j (bulk_ij/β_j + solid_ij) y_j. Finer grains loosen:
    a_ij = √(1 − (1 − d_j/d_i)^1.02) of their bulk volume is added. Coarser grains take their solid volume and, as
    walls, b_ij = 1 − (1 − d_i/d_j)^1.5 of their voids. Written out this is de Larrard's γ_i with Σ y_j = 1.
    """
    ratio = sizes[None, :] / sizes[:, None]  # d_j/d_i
    finer = ratio < 1.0
    loosening = np.sqrt(1.0 - (1.0 - np.minimum(ratio, 1.0)) ** 1.02)
    wall = 1.0 - (1.0 - 1.0 / np.maximum(ratio, 1.0)) ** 1.5
    return np.where(finer, loosening, wall), np.where(finer, 0.0, 1.0 - wall)


def _compacted(weights: Floats, poles: Floats, index: float | Floats) -> Floats:
    """Return the u above all poles with Σ_i weights_i/(u − poles_i) = ``index``, shape (M,).

    ``weights`` and ``poles``, shape (M, N); where a weight is zero, its pole does not count. ``index``: one, or
    shape (M, 1). Newton's method on 1/Σ − 1/index, which is concave and rises: from below it never passes the root.
    """
    present = weights > 0.0
    top = np.max(np.where(present, poles, -np.inf), axis=1, keepdims=True)
    below = np.where(present, top - poles, np.inf)
    above = np.max(weights / index - below, axis=1, keepdims=True)
    step = above
    while np.any(step > 1e-14 * above):
        terms = weights / (above + below)
        total = terms.sum(axis=1, keepdims=True)
        slope = (terms / (above + below)).sum(axis=1, keepdims=True)
        step = (total / index - 1.0) * total / slope
        above = above + np.maximum(step, 0.0)
    return np.asarray((top + above)[:, 0], dtype=np.float64)


@dataclass(frozen=True)
class FittedIndex:
    """A laboratory's own compaction index: ``value`` [-], root mean square of what is left in PD [-], mixtures."""

    value: float
    rms_error: float
    mixtures: int


def fit_compaction_index(materials: Sequence[Material], shares: ArrayLike, measured: ArrayLike) -> FittedIndex:
    """Return the compaction index K that fits a laboratory's own mixtures best, by least squares in PD.

    ``shares`` of the solid volume, shape (M, S), of all its aggregates; ``measured`` packing densities [-],
    shape (M,). Aggregates and mixtures are taken as compacted in the same way; the residual packing densities
    are solved anew for every K. Mixtures whose PD does not depend on K are left out. Raises TooFewData
    when fewer than two remain, OutOfReach when the best K lies at an end of its range, DensityError, ShareError.
    """
    alike = [replace(material, compaction=None) for material in materials]
    part, target = _checked(alike, shares), np.asarray(measured, dtype=np.float64)
    if target.shape != part.shape[:1]:
        raise ShareError(f"{target.size} measured packing densities for {len(part)} mixtures; give one of each")
    for value in target[~((target > 0.0) & (target < 1.0))]:
        raise DensityError(f"packing density {value:g} lies outside (0, 1); check it and its unit")
    ends = log_index_range(alike)
    moved = np.abs(np.subtract(*(cpm(alike, part, math.exp(end)) for end in ends))) > MOVED
    if moved.sum() < MIN_DATA:
        raise TooFewData(
            f"{moved.sum()} measured mixtures depend on the compaction index K, it takes {MIN_DATA} to fit it; "
            "measure mixtures of aggregates of different sizes"
        )
    return _least_squares(alike, part[moved], target[moved], ends)


def log_index_range(materials: Sequence[Material]) -> tuple[float, float]:
    """Return the logarithms of the least and the greatest compaction index to try, see ``fit_compaction_index``."""
    return math.log(max(map(_least_index, materials)) * 1.001), math.log(LARGEST_INDEX)


def _least_squares(
    materials: Sequence[Material], shares: Floats, measured: Floats, ends: tuple[float, float]
) -> FittedIndex:
    """Return the best K in a range of its logarithm, around the best of a grid."""

    def squares(log_index: float) -> float:
        return float(np.sum((cpm(materials, shares, math.exp(log_index)) - measured) ** 2))

    grid = np.linspace(*ends, 60)
    best = int(np.argmin([squares(value) for value in grid]))
    if best in (0, grid.size - 1):
        raise OutOfReach(
            f"no compaction index K between {math.exp(grid[0]):.3g} and {math.exp(grid[-1]):.3g} fits these mixtures, "
            f"the best lies at {math.exp(grid[best]):.3g}; check their tests, or take K by the compaction"
        )
    found = minimize_scalar(squares, bounds=(grid[best - 1], grid[best + 1]), method="bounded", options={"xatol": 1e-8})
    return FittedIndex(math.exp(found.x), math.sqrt(found.fun / measured.size), measured.size)


def _checked(materials: Sequence[Material], shares: ArrayLike) -> Floats:
    """Return the shares, shape (M, S), as parts of each mixture's sum. Raises ShareError."""
    part = np.asarray(shares, dtype=np.float64)
    if part.ndim != 2 or part.shape[1] != len(materials) or not materials:
        raise ShareError(
            f"shares of shape {part.shape} must be of (mixtures, {len(materials)} aggregates); correct them"
        )
    for row, column in np.argwhere(~((part >= 0.0) & (part <= 1.0 + SHARE_TOLERANCE))):
        raise ShareError(f"share {part[row, column]:g} in mixture {row + 1} lies outside [0, 1]; correct it")
    totals = part.sum(axis=1)
    for row in np.flatnonzero(np.abs(totals - 1.0) > SHARE_TOLERANCE):
        raise ShareError(
            f"the shares of mixture {row + 1} sum to {totals[row]:.6g}, more than {SHARE_TOLERANCE:g} off 1; "
            "correct them"
        )
    part = np.where(part < NEGLIGIBLE, 0.0, part)
    return np.asarray(part / part.sum(axis=1, keepdims=True), dtype=np.float64)


def check_compaction(method: str, materials: Sequence[Material], compaction: str | None) -> None:
    """Raise ProtocolError where a method that knows no compaction would mix packing densities of different ones."""
    ways = {material.compaction for material in materials} | {compaction}
    known = {"loose" if way == "unstated" else way for way in ways if way is not None}
    for way in known:
        compaction_index(way)
    if len(known) > 1:
        raise ProtocolError(
            f"{method} knows no compaction and cannot mix {' and '.join(sorted(known))}; enter tests of the same "
            "kind, or use cpm"
        )


def _index_of(compaction: str | float) -> float:
    index = compaction_index(compaction) if isinstance(compaction, str) else float(compaction)
    if not 0.0 < index < math.inf:
        raise ProtocolError(f"compaction index K = {index:g} must be above 0; see COMPACTION_INDEX")
    return index


def _by_size(materials: Sequence[Material], part: Floats) -> list[tuple[float, Floats, Floats]]:
    """Return diameter [mm], solid and bulk volume, shape (M,), of each size from the finest up."""
    sizes = list[tuple[float, Floats, Floats]]()
    for k in sorted(range(len(materials)), key=lambda k: materials[k].diameter):
        diameter, solid = materials[k].diameter, part[:, k]
        bulk = solid / materials[k].packing_density
        if sizes and diameter <= sizes[-1][0] * (1.0 + SAME_SIZE):
            first, before, volume = sizes.pop()
            diameter, solid, bulk = first, before + solid, volume + bulk
        sizes.append((diameter, solid, bulk))
    return sizes


Theory = Callable[[Sequence[Material], ArrayLike, str], Floats]

THEORIES: dict[str, Theory] = {"furnas": furnas, "toufar": toufar, "cpm": cpm}
"""Name → function of materials, shares (M, S) and the mixtures' compaction, which returns PD, shape (M,)."""
ABSENT = {"dewar": "the equations of Dewar, Computer Modelling of Concrete Mixtures, 1999, could not be read"}
"""Theories that are known by name only, each with the reason."""


def theory(name: str) -> Theory:
    """Return a theory by its name. Raises InputError for one that is absent, with the reason, or unknown."""
    if name in ABSENT:
        raise InputError(f"the theory '{name}' is absent: {ABSENT[name]}; use one of {', '.join(THEORIES)}")
    if name not in THEORIES:
        raise InputError(f"'{name}' is no theory; use one of {', '.join(THEORIES)}")
    return THEORIES[name]
