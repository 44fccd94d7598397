"""The friction coefficient whose simulated packing density is the measured one.

Equal spheres are simulated at fixed nodes of friction, so that every aggregate of a protocol shares its
runs with the next: PD falls with μ, and a monotone curve through the nodes is inverted. This module
runs nothing: it says which specimens it needs next and is handed their results.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, isotonic_regression

from pdlab.density import MeasuredPacking
from pdlab.errors import OutOfReach
from pdlab.specimen import LOOSE, Packing, Protocol, Specimen, equal_spheres, on_grid

METHOD = "monosized"
NODES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Friction coefficients at which the curve PD(μ) is simulated."""
FIRST_NODE = 0.2
FAR = 0.03
"""A PD farther than this beyond the known curve is looked for at the curve's end at once."""
SEEDS = 4
REACH = 2.0
"""Standard errors by which a measured PD may lie beyond the curve's end."""


@dataclass(frozen=True)
class CurvePoint:
    """One node of the curve: ``friction`` [-], mean PD over ``seeds`` runs, their PDs' deviation."""

    friction: float
    packing_density: float
    deviation: float
    seeds: int


@dataclass(frozen=True)
class Curve:
    """PD(μ) of equal spheres in one protocol, through at least one node, μ rising."""

    points: tuple[CurvePoint, ...]

    @property
    def _deviation(self) -> float:
        """Standard deviation of one run, pooled over the nodes."""
        freedom = sum(point.seeds - 1 for point in self.points)
        squares = sum((point.seeds - 1) * point.deviation**2 for point in self.points)
        return math.sqrt(squares / freedom) if freedom else math.nan

    def node_errors(self) -> np.ndarray:
        """Return the standard error of each node's PD, shape (K,)."""
        return np.array([self._deviation / math.sqrt(point.seeds) for point in self.points])

    def monotone(self) -> np.ndarray:
        """Return the nodes' PDs, shape (K,), made falling with μ where noise made them rise."""
        values = [point.packing_density for point in self.points]
        weights = [float(point.seeds) for point in self.points]
        return np.asarray(isotonic_regression(values, weights=weights, increasing=False).x)

    def at(self, friction: float) -> float:
        """Return the PD [-] at a friction coefficient within the nodes: monotone cubic over √μ."""
        roots = np.sqrt([point.friction for point in self.points])
        if roots.size == 1:
            return float(self.monotone()[0])
        return float(PchipInterpolator(roots, self.monotone())(math.sqrt(friction)))

    def error_at(self, friction: float) -> float:
        """Return the standard error of ``at``: the two nodes' around, by their weights."""
        roots, errors = np.sqrt([point.friction for point in self.points]), self.node_errors()
        right = int(np.clip(np.searchsorted(roots, math.sqrt(friction)), 1, max(1, roots.size - 1)))
        if roots.size == 1:
            return float(errors[0])
        weight = (math.sqrt(friction) - roots[right - 1]) / (roots[right] - roots[right - 1])
        return float(math.hypot(weight * errors[right], (1.0 - weight) * errors[right - 1]))

    def friction_at(self, packing_density: float) -> float:
        """Return the friction [-] at which the curve has a PD; the end's beyond an end."""
        first, last = self.points[0].friction, self.points[-1].friction
        if packing_density >= self.at(first):
            return first
        if packing_density <= self.at(last):
            return last
        root = brentq(lambda x: self.at(x * x) - packing_density, math.sqrt(first), math.sqrt(last), xtol=1e-9)
        return float(root) ** 2


@dataclass(frozen=True)
class Calibrated:
    """The friction of an aggregate's spheres and how well it is known.

    ``friction`` [-]; ``low`` and ``high`` are where the curve meets the measured PD plus and minus
    its error, None where it passes the curve's end. ``input_error`` and ``curve_error`` are in PD [-].
    """

    friction: float
    low: float | None
    high: float | None
    packing_density: float
    input_error: float
    curve_error: float
    warnings: tuple[str, ...] = ()


def node_specimens(friction: float, seeds: int = SEEDS, protocol: Protocol = LOOSE) -> list[Specimen]:
    """Return the beds of one node of the curve."""
    return [equal_spheres(friction, seed, protocol) for seed in range(1, seeds + 1)]


def curve(results: Mapping[float, Sequence[Packing]]) -> Curve:
    """Return the curve through the runs at each node's friction."""
    points = []
    for friction, packings in sorted(results.items()):
        values = np.array([packing.packing_density for packing in packings])
        spread = float(values.std(ddof=1)) if values.size > 1 else math.nan
        points.append(CurvePoint(friction, float(values.mean()), spread, values.size))
    return Curve(tuple(points))


def missing_nodes(measured: MeasuredPacking, known: Curve | None) -> set[float]:
    """Return the nodes whose runs are needed before ``solve`` can answer; empty when it can."""
    if known is None:
        return {FIRST_NODE}
    middle, error = measured.packing_density, measured.standard_error
    return {node for target in (middle, middle + error, middle - error) for node in _missing(target, known)}


def _missing(target: float, known: Curve) -> set[float]:
    """Return the node to look at next for a PD: towards an end, or between two that enclose it."""
    nodes = [point.friction for point in known.points]
    values = known.monotone()
    if target > values[0]:
        lower = [node for node in NODES if node < nodes[0]]
        return {lower[0] if target > values[0] + FAR else lower[-1]} if lower else set()
    if target < values[-1]:
        higher = [node for node in NODES if node > nodes[-1]]
        return {higher[-1] if target < values[-1] - FAR else higher[0]} if higher else set()
    right = max(1, int(np.searchsorted(-values, -target)))
    if right >= len(nodes):
        return set()
    between = [node for node in NODES if nodes[right - 1] < node < nodes[right]]
    return {between[len(between) // 2]} if between else set()


def solve(measured: MeasuredPacking, known: Curve) -> Calibrated:
    """Return the friction at which the curve has the measured PD, and its interval.

    Raises OutOfReach when the PD lies beyond the curve's end by more than two standard errors.
    """
    middle, error = measured.packing_density, measured.standard_error
    values = known.monotone()
    warnings = []
    for end, beyond, name in ((0, middle - values[0], "densest"), (-1, values[-1] - middle, "loosest")):
        if beyond > 0.0:
            allowed = REACH * math.hypot(error, float(known.node_errors()[end]))
            if beyond >= allowed:
                raise OutOfReach(_out_of_reach(middle, known))
            warnings.append(
                f"the measured PD {middle:.4f} lies beyond the {name} bed of equal spheres, {values[end]:.4f}, "
                "by less than two standard errors: the curve's end is taken"
            )
    friction = on_grid(known.friction_at(middle))
    return Calibrated(
        friction=friction,
        low=known.friction_at(middle + error) if middle + error <= values[0] else None,
        high=known.friction_at(middle - error) if middle - error >= values[-1] else None,
        packing_density=known.at(friction),
        input_error=error,
        curve_error=known.error_at(friction),
        warnings=tuple(warnings),
    )


def _out_of_reach(packing_density: float, known: Curve) -> str:
    """Name the reachable interval, as far as the simulated curve shows it."""
    values, ends = known.monotone(), (known.points[0].friction, known.points[-1].friction)
    low = f"{values[-1]:.3f}" if ends[1] == NODES[-1] else f"below {values[-1]:.3f}"
    high = f"{values[0]:.3f}" if ends[0] == NODES[0] else f"above {values[0]:.3f}"
    remedy = (
        "this material is looser than spheres with sliding friction alone: check that the test was a loose one"
        if packing_density < values[-1]
        else "this material is denser than equal spheres: split it into narrower size fractions"
    )
    return f"packing density {packing_density:.4g} is out of reach of '{METHOD}', which spans {low} to {high}; {remedy}"
