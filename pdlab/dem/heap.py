"""The angle of repose of a heap that lies on a round base about the axis x = y = 0, from the places alone.

Length is the largest diameter, the base is z = 0. The heap's surface is what a fine needle would meet from
above: the topmost point of the spheres over each point of the base, or the base itself.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

SPACING = 0.1
"""Distance of the needle's points, in largest diameters."""
FLANK = 0.2, 0.8
"""The part of the base's radius over which the flank is fitted: the rounded top and the foot are left out."""
SECTORS = 8
"""Sectors that the angle is averaged over: each some five diameters wide on a base of 26."""
FOOT = 0.9
"""The part of the base's radius beyond which a heap has its foot."""


@dataclass(frozen=True)
class Flank:
    """A heap's flank: its ``angle`` against the base, and that mean's ``standard_error`` over the sectors [degrees].

    ``top``: height of the surface at its highest; ``foot``: mean height beyond 0.9 of the base's radius.
    """

    angle: float
    standard_error: float
    top: float
    foot: float


def surface(place: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points x, y of the base, shape (P, 2), and the surface's height over each, shape (P,).

    ``place`` (N, 4): x, y, z, radius; ``radius`` of the base.
    """
    axis = np.arange(-math.floor(radius / SPACING), math.floor(radius / SPACING) + 1) * SPACING
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    points = points[np.hypot(*points.T) <= radius]
    height, needles = np.zeros(len(points)), cKDTree(points)
    for size in np.unique(place[:, 3]):
        some = place[place[:, 3] == size]
        met = cKDTree(some[:, :2]).sparse_distance_matrix(needles, size, output_type="ndarray")
        np.maximum.at(height, met["j"], some[met["i"], 2] + np.sqrt(size**2 - met["v"] ** 2))
    return points, height


def flank(place: np.ndarray, radius: float) -> Flank:
    """Return the flank of a heap on a base of ``radius``: in each sector a straight line by least squares.

    ``place`` (N, 4) in largest diameters. The line is the surface's height against the distance from the axis,
    between 0.2 and 0.8 of the base's radius.
    """
    points, height = surface(place, radius)
    off, turn = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0]) / (2.0 * math.pi) + 0.5
    sector = np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1)
    sloping = (off >= FLANK[0] * radius) & (off <= FLANK[1] * radius)
    angles = []
    for k in range(SECTORS):
        here = sloping & (sector == k)
        angles.append(-math.degrees(math.atan(np.polyfit(off[here], height[here], 1)[0])))
    return Flank(
        angle=float(np.mean(angles)),
        standard_error=float(np.std(angles, ddof=1) / math.sqrt(SECTORS)),
        top=float(height.max()),
        foot=float(height[off > FOOT * radius].mean()),
    )
