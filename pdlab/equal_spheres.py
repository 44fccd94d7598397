"""The packing density of equal spheres over friction and rolling friction, through beds on a grid of both."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from pdlab.errors import InputError


@dataclass(frozen=True)
class Surface:
    """PD(μ, μ_r) [-] of one protocol through the means at the nodes of a grid.

    ``frictions`` (F,) and ``rollings`` (R,) rise; ``densities`` and their standard ``errors`` have shape (F, R).
    """

    frictions: np.ndarray
    rollings: np.ndarray
    densities: np.ndarray
    errors: np.ndarray

    def at(self, friction: float, rolling: float) -> tuple[float, float]:
        """Return the PD and its standard error: monotone cubics over the coefficients' roots, one after the other.

        The error is that of the nodes around, by their weights, and for either coefficient the cubic's distance from
        the straight line between two nodes. Raises InputError outside the grid.
        """
        for name, value, nodes in (("friction", friction, self.frictions), ("rolling", rolling, self.rollings)):
            if not nodes[0] <= value <= nodes[-1]:
                raise InputError(f"{name} {value:g} lies outside [{nodes[0]:g}, {nodes[-1]:g}], where beds were run")
        mu, mu_r = np.sqrt(self.frictions), np.sqrt(self.rollings)
        across, along = _hats(mu, math.sqrt(friction)), _hats(mu_r, math.sqrt(rolling))
        profile = PchipInterpolator(mu_r, self.densities, axis=1)(math.sqrt(rolling))  # (F,)
        density = float(PchipInterpolator(mu, profile)(math.sqrt(friction)))
        nodes_error = float(np.linalg.norm(np.outer(across, along) * self.errors))
        bends = density - float(across @ profile), float(across @ (profile - self.densities @ along))
        return density, math.hypot(nodes_error, *bends)


def _hats(nodes: np.ndarray, place: float) -> np.ndarray:
    """Return each node's weight (K,) in the straight line between the two nodes around a place."""
    return np.array([np.interp(place, nodes, hat) for hat in np.eye(nodes.size)])


def through(densities: Mapping[tuple[float, float], Sequence[float]]) -> Surface:
    """Return the surface through beds' PDs [-] by friction and rolling friction, several seeds to each pair.

    Its grid is that of the pairs off the two edges, no rolling friction and the largest friction, and of these edges.
    The deviation of one bed is pooled over all pairs. Raises InputError where a pair of the grid has no bed.
    """
    roughest = max(friction for friction, _ in densities)
    inside = [(friction, rolling) for friction, rolling in densities if friction < roughest and rolling > 0.0]
    frictions = sorted({friction for friction, _ in inside} | {roughest})
    rollings = sorted({rolling for _, rolling in inside} | {0.0})
    missing = [(mu, mu_r) for mu in frictions for mu_r in rollings if (mu, mu_r) not in densities]
    if missing or not inside:
        raise InputError(f"no bed was run at {missing or 'any pair of friction and rolling friction'}; run some there")
    seeds = np.array([[len(densities[mu, mu_r]) for mu_r in rollings] for mu in frictions])
    means = np.array([[np.mean(densities[mu, mu_r]) for mu_r in rollings] for mu in frictions])
    freedom = sum(len(some) - 1 for some in densities.values())
    squares = sum(len(some) * float(np.var(some)) for some in densities.values())
    deviation = math.sqrt(squares / freedom) if freedom else math.nan
    return Surface(np.array(frictions), np.array(rollings), means, deviation / np.sqrt(seeds))
