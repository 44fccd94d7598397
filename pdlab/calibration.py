"""The coefficient whose simulated packing density, or angle of repose, is the measured one.

Beds are simulated at fixed nodes of a coefficient, so that every aggregate of a protocol shares its runs with
the next: PD falls with friction and with rolling resistance, a heap's angle rises, and a monotone curve through
the nodes is inverted. This module runs nothing: it says which specimens it needs next and is handed their results.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pdlab.angles import MeasuredAngle
from pdlab.density import MeasuredPacking
from pdlab.errors import OutOfReach
from pdlab.specimen import (
    LOOSE,
    Packing,
    Protocol,
    Sizes,
    Specimen,
    components,
    equal_spheres,
    heap_spheres,
    mixed_spheres,
    on_grid,
    with_seeds,
)

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

Measured = MeasuredPacking | MeasuredAngle
MONOSIZED, ROLLING, GRADED, REPOSE = "monosized", "monosized_rolling", "graded", "repose"
METHOD = MONOSIZED
NODES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Coefficients at which the curve is simulated: friction, and rolling friction where that is calibrated."""
FIRST_NODE = 0.2
ROUGHEST = 1.0
"""The friction that is held where rolling friction is calibrated."""
SEEDS, LEAST_SEEDS = 4, 2
"""Beds at a node that the curve is carried on to, and those that a node must have to be told an error."""
REACH = 2.0
"""Standard errors by which a measured value may lie beyond the curve's end."""


@dataclass(frozen=True)
class Sought:
    """The quantity of a bed that is to be the measured one; with the coefficient it rises (``sign`` 1) or falls (-1).

    ``column`` of a Packing; ``name``, ``short`` name, ``digits`` and ``unit`` in messages; ``first`` and ``last``: the
    bed at the smallest and at the largest coefficient.
    """

    column: str
    sign: int
    name: str
    short: str
    digits: int
    unit: str
    first: str
    last: str


DENSITY = Sought("packing_density", -1, "packing density", "PD", 3, "", "densest bed", "loosest bed")
ANGLE = Sought("repose_angle_deg", 1, "angle of repose", "angle", 1, " degrees", "flattest heap", "steepest heap")


@dataclass(frozen=True)
class Ladder:
    """The beds along which one coefficient of an aggregate's spheres is calibrated.

    ``method``: monosized and graded calibrate friction, monosized_rolling the rolling friction at a friction of 1.
    Under the protocol ``repose`` they are heaps of equal spheres, whose angle is calibrated.
    """

    method: str
    sizes: Sizes
    protocol: Protocol = LOOSE

    @property
    def sought(self) -> Sought:
        """What of its beds is to be the measured one."""
        return ANGLE if self.protocol.compaction == "repose" else DENSITY

    def coefficients(self, value: float) -> tuple[float, float]:
        """Return friction and rolling friction [-] where the calibrated coefficient has a ``value``."""
        return (ROUGHEST, value) if self.method == ROLLING else (value, 0.0)

    def beds(self, node: float, seeds: int = SEEDS) -> list[Specimen]:
        """Return the beds of a node. Raises SpecimenTooLarge."""
        friction, rolling = self.coefficients(node)
        if self.sought is ANGLE:
            first = heap_spheres(friction, 1, rolling, protocol=self.protocol)
        else:
            first = mixed_spheres(components(self.sizes, friction, rolling), 1, self.protocol)
        return with_seeds(first, range(1, seeds + 1))


@dataclass(frozen=True)
class CurvePoint:
    """One node of the curve: the coefficient's ``value`` [-], the ``mean`` over ``seeds`` runs and their deviation."""

    value: float
    mean: float
    deviation: float
    seeds: int


@dataclass(frozen=True)
class Curve:
    """What is ``sought`` over the calibrated coefficient in one protocol, through at least one node.

    The coefficient rises along the ``points``. Values are PD [-], or angles of repose [degrees].
    """

    points: tuple[CurvePoint, ...]
    sought: Sought = DENSITY

    @cached_property
    def _deviation(self) -> float:
        """Standard deviation of one run, pooled over the nodes."""
        freedom = sum(point.seeds - 1 for point in self.points)
        squares = sum((point.seeds - 1) * point.deviation**2 for point in self.points if point.seeds > 1)
        return math.sqrt(squares / freedom) if freedom else math.nan

    def node_errors(self) -> np.ndarray:
        """Return the standard error of each node's mean, shape (K,)."""
        return np.array([self._deviation / math.sqrt(point.seeds) for point in self.points])

    def monotone(self) -> np.ndarray:
        """Return the nodes' means, shape (K,), made falling where noise made them rise, or the other way round."""
        return self._monotone.copy()

    @cached_property
    def _monotone(self) -> np.ndarray:
        from scipy.optimize import isotonic_regression  # scipy takes 0.4 s, and the store imports this module

        values = [point.mean for point in self.points]
        weights = [float(point.seeds) for point in self.points]
        return np.asarray(isotonic_regression(values, weights=weights, increasing=self.sought.sign > 0).x)

    @cached_property
    def _roots(self) -> np.ndarray:
        return np.sqrt([point.value for point in self.points])

    @cached_property
    def _smooth(self) -> "PchipInterpolator":
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self._roots, self._monotone)

    def at(self, value: float) -> float:
        """Return the value at a coefficient within the nodes: monotone cubic over its root."""
        if len(self.points) == 1:
            return float(self._monotone[0])
        return float(self._smooth(math.sqrt(value)))

    def error_at(self, value: float) -> float:
        """Return the standard error of ``at``: the two nodes' around, by their weights, and the interpolation's.

        The latter is taken as the cubic's distance from the straight line between the two nodes.
        """
        errors, roots = self.node_errors(), self._roots
        if roots.size == 1:
            return float(errors[0])
        right = int(np.clip(np.searchsorted(roots, math.sqrt(value)), 1, roots.size - 1))
        weight = (math.sqrt(value) - roots[right - 1]) / (roots[right] - roots[right - 1])
        nodes = math.hypot(weight * errors[right], (1.0 - weight) * errors[right - 1])
        straight = float(np.interp(math.sqrt(value), roots, self._monotone))
        return math.hypot(nodes, self.at(value) - straight)

    def value_at(self, target: float) -> float:
        """Return the coefficient [-] at which the curve has a PD, or an angle; the end's beyond an end."""
        first, last, sign = self.points[0].value, self.points[-1].value, self.sought.sign
        if sign * target <= sign * self.at(first):
            return first
        if sign * target >= sign * self.at(last):
            return last
        from scipy.optimize import brentq

        root = brentq(lambda x: float(self._smooth(x)) - target, math.sqrt(first), math.sqrt(last), xtol=1e-9)
        return float(root) ** 2


@dataclass(frozen=True)
class Met:
    """The coefficient at which a curve has the measured value: ``value`` [-], its interval as in ``Calibrated``."""

    value: float
    low: float | None
    high: float | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Calibrated:
    """The coefficient of an aggregate's spheres and how well it is known.

    ``value`` [-]; ``low`` and ``high`` are where the curve meets the measured PD, or angle, plus and minus
    its error, None where it passes the curve's end. ``input_error`` and ``curve_error`` are in PD [-], as is the
    ``packing_density`` of the calibrated spheres.
    """

    value: float
    low: float | None
    high: float | None
    packing_density: float
    input_error: float
    curve_error: float
    warnings: tuple[str, ...] = ()


def curve(results: Mapping[float, Sequence[Packing]], sought: Sought = DENSITY) -> Curve | None:
    """Return the curve through the runs at the nodes; None before the first node is simulated.

    It goes from there to both sides as far as no node is missing.
    """
    simulated = [bool(results.get(node)) for node in NODES]
    first = last = NODES.index(FIRST_NODE)
    if not simulated[first]:
        return None
    while first > 0 and simulated[first - 1]:
        first -= 1
    while last < len(NODES) - 1 and simulated[last + 1]:
        last += 1
    return Curve(tuple(_point(node, results[node], sought) for node in NODES[first : last + 1]), sought)


def _point(node: float, packings: Sequence[Packing], sought: Sought = DENSITY) -> CurvePoint:
    values = np.array([getattr(packing, sought.column) for packing in packings])
    spread = float(values.std(ddof=1)) if values.size > 1 else math.nan
    return CurvePoint(node, float(values.mean()), spread, values.size)


def reach(results: Mapping[float, Sequence[Packing]], sought: Sought = DENSITY) -> tuple[float | None, float | None]:
    """Return the least and the largest value of a ladder, at its ends, None where that end is not simulated.

    PDs [-] of the loosest and of the densest bed, or angles [degrees] of the flattest and of the steepest heap.
    """
    ends = [results.get(NODES[end]) for end in (0, -1)[:: sought.sign]]
    low, high = (_point(0.0, packings, sought).mean if packings else None for packings in ends)
    return low, high


def missing_nodes(measured: Measured, known: Curve | None, seeds: int = SEEDS) -> dict[float, int]:
    """Return the nodes whose runs ``solve`` still needs, each with its number of beds; empty when it can answer.

    The curve is carried on node by node, ``seeds`` beds at each, until it encloses the measured value and its error on
    both sides; inside it nothing is missing. More seeds than usual are asked of the nodes around the answer.
    """
    if known is None:
        return {FIRST_NODE: seeds}
    middle, error = measured.value, measured.standard_error
    further = {_further(target, known) for target in (middle, middle + error, middle - error)}
    if further != {None}:
        return {node: seeds for node in further if node is not None}
    least = seeds if seeds > SEEDS else LEAST_SEEDS
    return {point.value: seeds for point in _bracket(middle, known) if point.seeds < least}


def _further(target: float, known: Curve) -> float | None:
    """Return the next node towards a value beyond the known curve, None where it is inside or the nodes end."""
    values, sign = known.monotone(), known.sought.sign
    if sign * target < sign * values[0]:
        return max((node for node in NODES if node < known.points[0].value), default=None)
    if sign * target > sign * values[-1]:
        return min((node for node in NODES if node > known.points[-1].value), default=None)
    return None


def _bracket(target: float, known: Curve) -> tuple[CurvePoint, ...]:
    """Return the neighbouring nodes that enclose a value; of one beyond the curve the node at its end."""
    sign = known.sought.sign
    right = int(np.searchsorted(sign * known.monotone(), sign * target))
    return known.points[max(0, right - 1) : right + 1]


def meet(measured: Measured, known: Curve, method: str = METHOD) -> Met:
    """Return the coefficient at which the curve has the measured value, and its interval.

    Raises OutOfReach when the value lies beyond the curve's end by more than two standard errors.
    """
    middle, error, sign = measured.value, measured.standard_error, known.sought.sign
    values, warnings = known.monotone(), _beyond(measured, known, method)
    smoother, rougher = middle - sign * error, middle + sign * error
    return Met(
        value=on_grid(known.value_at(middle)),
        low=known.value_at(smoother) if sign * smoother >= sign * values[0] else None,
        high=known.value_at(rougher) if sign * rougher <= sign * values[-1] else None,
        warnings=tuple(warnings),
    )


def _beyond(measured: Measured, known: Curve, method: str) -> list[str]:
    """Return the warning of a value that lies beyond an end of the curve, if any. Raises OutOfReach."""
    middle, sought, values = measured.value, known.sought, known.monotone()
    for end, beyond, name in (
        (0, sought.sign * (values[0] - middle), sought.first),
        (-1, sought.sign * (middle - values[-1]), sought.last),
    ):
        if beyond > 0.0:
            if beyond >= REACH * math.hypot(measured.standard_error, float(known.node_errors()[end])):
                ends = " to ".join(f"{value:.{sought.digits}f}" for value in sorted((values[0], values[-1])))
                raise OutOfReach(
                    f"{sought.name} {middle:.4g}{sought.unit} is out of reach of '{method}', which was simulated from "
                    f"{ends}{sought.unit}",
                    looser=end == -1,
                )
            digits = sought.digits + 1
            return [
                f"the measured {sought.short} {middle:.{digits}f}{sought.unit} lies beyond the {name} of '{method}', "
                f"{values[end]:.{digits}f}{sought.unit}, by less than two standard errors: the curve's end is taken"
            ]
    return []


def solve(measured: MeasuredPacking, known: Curve, method: str = METHOD) -> Calibrated:
    """Return the coefficient at which the curve has the measured PD, and its interval. Raises OutOfReach."""
    found = meet(measured, known, method)
    density, error = known.at(found.value), known.error_at(found.value)
    return Calibrated(found.value, found.low, found.high, density, measured.standard_error, error, found.warnings)


def beside(met: Met, measured: Measured, known: Curve) -> tuple[float, float]:
    """Return the coefficients [-] on both sides of the one met, between which errors are carried to PD.

    Where the curve is off by the measured value's error; the curve's end where it passes it.
    """
    middle, step = known.at(met.value), known.sought.sign * measured.standard_error
    return on_grid(known.value_at(middle - step)), on_grid(known.value_at(middle + step))


def equal_beds(friction: float, protocol: Protocol, seeds: int = SEEDS) -> list[Specimen]:
    """Return beds of equal spheres of a calibrated friction [-]."""
    return with_seeds(equal_spheres(friction, 1, protocol), range(1, seeds + 1))


def packed(met: Met, measured: Measured, known: Curve, beds: Mapping[float, Sequence[Packing]]) -> Calibrated:
    """Return a calibration to an angle, with the packing density of its spheres.

    ``beds``: those of the coefficient met and of the two ``beside`` it. The angle's error, and its curve's, become
    errors in PD by the slope of PD over the angle between these two; the curve's error holds the beds' own too.
    """
    here = _point(met.value, beds[met.value])
    low, high = beside(met, measured, known)
    apart = _point(high, beds[high]).mean - _point(low, beds[low]).mean
    slope = abs(apart / (known.at(high) - known.at(low)))
    curve_error = math.hypot(here.deviation / math.sqrt(here.seeds), slope * known.error_at(met.value))
    return Calibrated(
        met.value, met.low, met.high, here.mean, slope * measured.standard_error, curve_error, met.warnings
    )


def span(reach: tuple[float | None, float | None]) -> str:
    """Return an interval of packing densities as text; an end that is not simulated is left open."""
    low, high = reach
    if low is None and high is None:
        return "an interval that is not simulated yet"
    if high is None:
        return f"{low:.3f} and denser"
    return f"{high:.3f} and looser" if low is None else f"{low:.3f} to {high:.3f}"
