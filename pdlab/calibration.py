"""The coefficient whose simulated packing density is the measured one.

Beds are simulated at fixed nodes of a coefficient, so that every aggregate of a protocol shares its runs with
the next: PD falls with friction and with rolling resistance, and a monotone curve through the nodes is
inverted. This module runs nothing: it says which specimens it needs next and is handed their results.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, isotonic_regression

from pdlab.density import MeasuredPacking
from pdlab.errors import OutOfReach
from pdlab.specimen import LOOSE, Packing, Protocol, Sizes, Specimen, components, mixed_spheres, on_grid, with_seeds

MONOSIZED, ROLLING, GRADED = "monosized", "monosized_rolling", "graded"
METHOD = MONOSIZED
NODES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Coefficients at which the curve is simulated: friction, and rolling friction where that is calibrated."""
FIRST_NODE = 0.2
ROUGHEST = 1.0
"""The friction that is held where rolling friction is calibrated."""
SEEDS, LEAST_SEEDS = 4, 2
"""Beds at a node that the curve is carried on to, and those that a node must have to be told an error."""
REACH = 2.0
"""Standard errors by which a measured PD may lie beyond the curve's end."""


@dataclass(frozen=True)
class Ladder:
    """The beds along which one coefficient of an aggregate's spheres is calibrated.

    ``method``: monosized and graded calibrate friction, monosized_rolling the rolling friction at a friction of 1.
    """

    method: str
    sizes: Sizes
    protocol: Protocol = LOOSE

    def coefficients(self, value: float) -> tuple[float, float]:
        """Return friction and rolling friction [-] where the calibrated coefficient has a ``value``."""
        return (ROUGHEST, value) if self.method == ROLLING else (value, 0.0)

    def beds(self, node: float, seeds: int = SEEDS) -> list[Specimen]:
        """Return the beds of a node. Raises SpecimenTooLarge."""
        friction, rolling = self.coefficients(node)
        first = mixed_spheres(components(self.sizes, friction, rolling), 1, self.protocol)
        return with_seeds(first, range(1, seeds + 1))


@dataclass(frozen=True)
class CurvePoint:
    """One node of the curve: the coefficient's ``value`` [-], mean PD over ``seeds`` runs, their PDs' deviation."""

    value: float
    packing_density: float
    deviation: float
    seeds: int


@dataclass(frozen=True)
class Curve:
    """PD over the calibrated coefficient in one protocol, through at least one node, the coefficient rising."""

    points: tuple[CurvePoint, ...]

    @property
    def _deviation(self) -> float:
        """Standard deviation of one run, pooled over the nodes."""
        freedom = sum(point.seeds - 1 for point in self.points)
        squares = sum((point.seeds - 1) * point.deviation**2 for point in self.points if point.seeds > 1)
        return math.sqrt(squares / freedom) if freedom else math.nan

    def node_errors(self) -> np.ndarray:
        """Return the standard error of each node's PD, shape (K,)."""
        return np.array([self._deviation / math.sqrt(point.seeds) for point in self.points])

    def monotone(self) -> np.ndarray:
        """Return the nodes' PDs, shape (K,), made falling where noise made them rise."""
        values = [point.packing_density for point in self.points]
        weights = [float(point.seeds) for point in self.points]
        return np.asarray(isotonic_regression(values, weights=weights, increasing=False).x)

    @property
    def _roots(self) -> np.ndarray:
        return np.sqrt([point.value for point in self.points])

    def at(self, value: float) -> float:
        """Return the PD [-] at a coefficient within the nodes: monotone cubic over its root."""
        if len(self.points) == 1:
            return float(self.monotone()[0])
        return float(PchipInterpolator(self._roots, self.monotone())(math.sqrt(value)))

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
        straight = float(np.interp(math.sqrt(value), roots, self.monotone()))
        return math.hypot(nodes, self.at(value) - straight)

    def value_at(self, packing_density: float) -> float:
        """Return the coefficient [-] at which the curve has a PD; the end's beyond an end."""
        first, last = self.points[0].value, self.points[-1].value
        if packing_density >= self.at(first):
            return first
        if packing_density <= self.at(last):
            return last
        smooth = PchipInterpolator(self._roots, self.monotone())
        root = brentq(lambda x: float(smooth(x)) - packing_density, math.sqrt(first), math.sqrt(last), xtol=1e-9)
        return float(root) ** 2


@dataclass(frozen=True)
class Calibrated:
    """The coefficient of an aggregate's spheres and how well it is known.

    ``value`` [-]; ``low`` and ``high`` are where the curve meets the measured PD plus and minus
    its error, None where it passes the curve's end. ``input_error`` and ``curve_error`` are in PD [-].
    """

    value: float
    low: float | None
    high: float | None
    packing_density: float
    input_error: float
    curve_error: float
    warnings: tuple[str, ...] = ()


def curve(results: Mapping[float, Sequence[Packing]]) -> Curve | None:
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
    return Curve(tuple(_point(node, results[node]) for node in NODES[first : last + 1]))


def _point(node: float, packings: Sequence[Packing]) -> CurvePoint:
    values = np.array([packing.packing_density for packing in packings])
    spread = float(values.std(ddof=1)) if values.size > 1 else math.nan
    return CurvePoint(node, float(values.mean()), spread, values.size)


def reach(results: Mapping[float, Sequence[Packing]]) -> tuple[float | None, float | None]:
    """Return the PDs [-] of the loosest and of the densest bed of a ladder, None where that is not simulated."""
    ends = (results.get(NODES[-1]), results.get(NODES[0]))
    low, high = (_point(0.0, packings).packing_density if packings else None for packings in ends)
    return low, high


def missing_nodes(measured: MeasuredPacking, known: Curve | None, seeds: int = SEEDS) -> dict[float, int]:
    """Return the nodes whose runs ``solve`` still needs, each with its number of beds; empty when it can answer.

    The curve is carried on node by node, ``seeds`` beds at each, until it encloses the measured PD and its error on
    both sides; inside it nothing is missing. More seeds than usual are asked of the nodes around the answer.
    """
    if known is None:
        return {FIRST_NODE: seeds}
    middle, error = measured.packing_density, measured.standard_error
    further = {_further(target, known) for target in (middle, middle + error, middle - error)}
    if further != {None}:
        return {node: seeds for node in further if node is not None}
    least = seeds if seeds > SEEDS else LEAST_SEEDS
    return {point.value: seeds for point in _bracket(middle, known) if point.seeds < least}


def _further(target: float, known: Curve) -> float | None:
    """Return the next node towards a PD beyond the known curve, None where it is inside or the nodes end."""
    values = known.monotone()
    if target > values[0]:
        return max((node for node in NODES if node < known.points[0].value), default=None)
    if target < values[-1]:
        return min((node for node in NODES if node > known.points[-1].value), default=None)
    return None


def _bracket(target: float, known: Curve) -> tuple[CurvePoint, ...]:
    """Return the neighbouring nodes that enclose a PD; of a PD beyond the curve the node at its end."""
    right = int(np.searchsorted(-known.monotone(), -target))
    return known.points[max(0, right - 1) : right + 1]


def solve(measured: MeasuredPacking, known: Curve, method: str = METHOD) -> Calibrated:
    """Return the coefficient at which the curve has the measured PD, and its interval.

    Raises OutOfReach when the PD lies beyond the curve's end by more than two standard errors.
    """
    middle, error = measured.packing_density, measured.standard_error
    values = known.monotone()
    warnings = []
    for end, beyond, name in ((0, middle - values[0], "densest"), (-1, values[-1] - middle, "loosest")):
        if beyond > 0.0:
            allowed = REACH * math.hypot(error, float(known.node_errors()[end]))
            if beyond >= allowed:
                ends = f"{values[-1]:.3f} to {values[0]:.3f}"
                raise OutOfReach(
                    f"packing density {middle:.4g} is out of reach of '{method}', which was simulated from {ends}",
                    looser=end == -1,
                )
            warnings.append(
                f"the measured PD {middle:.4f} lies beyond the {name} bed of '{method}', {values[end]:.4f}, "
                "by less than two standard errors: the curve's end is taken"
            )
    value = on_grid(known.value_at(middle))
    return Calibrated(
        value=value,
        low=known.value_at(middle + error) if middle + error <= values[0] else None,
        high=known.value_at(middle - error) if middle - error >= values[-1] else None,
        packing_density=known.at(value),
        input_error=error,
        curve_error=known.error_at(value),
        warnings=tuple(warnings),
    )


def span(reach: tuple[float | None, float | None]) -> str:
    """Return an interval of packing densities as text; an end that is not simulated is left open."""
    low, high = reach
    if low is None and high is None:
        return "an interval that is not simulated yet"
    if high is None:
        return f"{low:.3f} and denser"
    return f"{high:.3f} and looser" if low is None else f"{low:.3f} to {high:.3f}"
