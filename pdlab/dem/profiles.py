"""What a bed shows from place to place: profiles of its packing density, pair distribution, contacts by species.

All from the positions, ``place`` (N, 4): x, y, z, radius in reduced units (length: the largest diameter), so
that stored beds are read like those that just settled. A periodic bed repeats along x and y by its width; a
cylinder stands about the axis x = y = 0. The floor is z = 0.
"""

import math
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from pdlab.dem.measures import solid_fraction, solids_between
from pdlab.errors import InputError

GAP = 1e-9
"""Gap, in largest diameters, up to which spheres that geometry alone placed are in contact: rounding is smaller."""
NODES = 16
"""Gauss-Legendre nodes between two kinks of a slice's area: a sphere's part in a cylinder to 1e-8 of it."""


def height_profile(place: np.ndarray, area: float, edges: np.ndarray) -> np.ndarray:
    """Return the packing density between consecutive planes, shape (K,), cut spheres by exact segments.

    ``area`` of the floor; ``edges`` (K + 1,): heights of the planes above the floor, rising. Raises InputError.
    """
    _check_rising(edges)
    return np.array([solid_fraction(place, area, float(low), float(high)) for low, high in pairwise(edges)])


def wall_profile(place: np.ndarray, radius: float, low: float, high: float, edges: np.ndarray) -> np.ndarray:
    """Return the packing density in rings at a cylinder's wall, shape (K,), between two planes.

    ``radius`` of the cylinder; ``low``, ``high``: heights of the planes; ``edges`` (K + 1,): distances from the
    wall, rising, 0 to ``radius``. Exact but for an integration to 1e-8 of each sphere cut. What presses into
    the wall lies beyond it and does not count. Raises InputError.
    """
    _check_rising(edges)
    if edges[-1] > radius:
        raise InputError(
            f"a distance of {edges[-1]:g} from the wall lies beyond the cylinder's axis, {radius:g} away; "
            "choose a smaller one"
        )
    inner = radius - np.asarray(edges, dtype=np.float64)
    solids = np.array([solids_in_cylinder(place, float(rho), low, high).sum() for rho in inner])
    rings = math.pi * (inner[:-1] ** 2 - inner[1:] ** 2)
    return np.asarray((solids[:-1] - solids[1:]) / (rings * (high - low)))


def solids_in_cylinder(place: np.ndarray, radius: float, low: float, high: float) -> np.ndarray:
    """Return each sphere's volume within ``radius`` of the axis x = y = 0 and between two planes, shape (N,).

    A horizontal slice shares the lens of two circles with the cylinder; the slices are integrated over the
    height, from kink to kink, to 1e-8 of the sphere.
    """
    off, r = np.hypot(place[:, 0], place[:, 1]), place[:, 3]
    volume = np.where(off < radius, solids_between(place, low, high), 0.0)
    cut = (np.abs(off - radius) < r) & (place[:, 2] - r < high) & (place[:, 2] + r > low)
    volume[cut] = _cut_volume(place[cut], off[cut], radius, low, high)
    return volume


def _cut_volume(place: np.ndarray, off: np.ndarray, radius: float, low: float, high: float) -> np.ndarray:
    """Return the volumes (M,) of spheres that a cylinder cuts, ``off`` (M,) its axis.

    Where a slice begins to touch the cylinder, from within or without, its area has a kink. The sine takes
    the roots out of the integrand at both ends of each part.
    """
    z, r = place[:, 2], place[:, 3]
    touch, cover = (np.sqrt(np.maximum(r**2 - reach**2, 0.0)) for reach in (off - radius, off + radius))
    kinks = np.stack([-r, -touch, -cover, cover, touch, r], axis=1)
    kinks = np.clip(kinks, (low - z)[:, None], (high - z)[:, None])
    middle, half = 0.5 * (kinks[:, 1:] + kinks[:, :-1]), 0.5 * (kinks[:, 1:] - kinks[:, :-1])
    node, weight = np.polynomial.legendre.leggauss(NODES)
    t = middle[..., None] + half[..., None] * np.sin(0.5 * math.pi * node)
    slice_radius = np.sqrt(np.maximum(r[:, None, None] ** 2 - t**2, 0.0))
    area = _lens(slice_radius, radius, off[:, None, None])
    return np.asarray((half * (area * weight * 0.5 * math.pi * np.cos(0.5 * math.pi * node)).sum(axis=2)).sum(axis=1))


def _lens(a: np.ndarray, b: float, apart: np.ndarray) -> np.ndarray:
    """Return the area that circles of radii ``a`` and ``b``, ``apart`` from centre to centre, share."""
    tiny = np.finfo(np.float64).tiny  # a circle of no radius, or both about one centre: the cosine is beyond ±1
    at_a = np.arccos(np.clip((apart**2 + a**2 - b**2) / np.maximum(2.0 * apart * a, tiny), -1.0, 1.0))
    at_b = np.arccos(np.clip((apart**2 + b**2 - a**2) / np.maximum(2.0 * apart * b, tiny), -1.0, 1.0))
    return np.asarray(a**2 * (at_a - 0.5 * np.sin(2.0 * at_a)) + b**2 * (at_b - 0.5 * np.sin(2.0 * at_b)))


def pair_distribution(place: np.ndarray, width: float, low: float, high: float, edges: np.ndarray) -> np.ndarray:
    """Return the pair distribution g(r) of the spheres centred in a slab of a periodic bed, shape (K,).

    Both spheres of a pair lie in the slab, from ``low`` to ``high``. The pairs in each shell are divided by
    those that as many random points would have there: of a sphere's shell only the exact part inside the
    slab counts. ``edges`` (K + 1,): distances of centres, rising, from 0 to half the ``width``. For one
    species give its spheres alone. NaN where the slab holds fewer than two. Raises InputError.
    """
    _check_rising(edges)
    if edges[0] < 0.0:
        raise InputError(f"a distance of {edges[0]:g} between centres is negative; choose 0 or more")
    inside = place[(place[:, 2] >= low) & (place[:, 2] <= high)]
    tree = _tree(inside, width, float(edges[-1]))
    pairs = np.asarray(tree.count_neighbors(tree, np.asarray(edges, dtype=np.float64), cumulative=False))[1:]
    balls = [solids_between(np.insert(inside[:, :3], 3, r, axis=1), low, high).sum() for r in edges]
    random = (len(inside) - 1) / (width**2 * (high - low)) * np.diff(balls)
    return _ratio(pairs, random)


def touching(place: np.ndarray, width: float | None, gap: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the spheres i < j of every contact and its overlap in the unit of ``place``, each of shape (C,).

    ``width`` of the periodic box, None where nothing repeats. ``gap``: up to which spheres are in contact, their
    overlap then negative. In the order of i, then j. Raises InputError where half the width is less than the
    largest diameter.
    """
    sizes, size = np.unique(place[:, 3], return_inverse=True)
    members = [np.flatnonzero(size == k) for k in range(sizes.size)]
    trees = [_tree(place[one], width, 2.0 * float(sizes[-1]) + gap) for one in members]
    found = []
    for a in range(sizes.size):
        for b in range(a, sizes.size):
            near = trees[a].sparse_distance_matrix(trees[b], sizes[a] + sizes[b] + gap, output_type="ndarray")
            i, j, overlap = members[a][near["i"]], members[b][near["j"]], sizes[a] + sizes[b] - near["v"]
            kept = (overlap > -gap) & ((i < j) | (a < b))  # within a size every pair comes twice
            found.append(np.stack([np.minimum(i, j)[kept], np.maximum(i, j)[kept], overlap[kept]]))
    i, j, overlap = np.concatenate(found, axis=1)
    order = np.lexsort((j, i))
    return i[order].astype(np.int64), j[order].astype(np.int64), overlap[order]


def contacts_by_species(
    i: np.ndarray, j: np.ndarray, species: np.ndarray, counted: np.ndarray, kinds: int
) -> np.ndarray:
    """Return the mean contacts that a sphere of species a has with spheres of species b, shape (S, S).

    ``i``, ``j`` (C,): the spheres of each contact; ``species`` (N,), below ``kinds``; ``counted`` (N,): the
    spheres a whose contacts count, a slab's say, whatever the place of b. A row sums to the coordination
    number of its species, rattlers included, walls not; it is NaN where none of the species is counted.
    """
    one, other = np.concatenate([i, j]), np.concatenate([j, i])
    kind = species[one].astype(np.int64) * kinds + species[other]
    contacts = np.bincount(kind, counted[one], kinds**2).reshape(kinds, kinds)
    return _ratio(contacts, np.bincount(species[counted], minlength=kinds)[:, None] + np.zeros(kinds))


def into_box(place: np.ndarray, width: float) -> np.ndarray:
    """Return places (N, 4) with x and y brought into [0, ``width``) of a periodic bed."""
    out = place.copy()
    out[:, :2] %= width
    out[:, :2][out[:, :2] == width] = 0.0  # the remainder of a negative number next to 0 is rounded up
    return out


def _tree(place: np.ndarray, width: float | None, reach: float) -> cKDTree:
    """Return the centres for searches as far as ``reach``. Raises InputError beyond half the width."""
    if width is None:
        return cKDTree(place[:, :3])
    if reach > 0.5 * width:
        raise InputError(
            f"a reach of {reach:g} is more than half the periodic width of {width:g}: a sphere would meet two images "
            "of another; choose a smaller reach"
        )
    return cKDTree(into_box(place, width)[:, :3], boxsize=np.array([width, width, 0.0]))


def _check_rising(edges: np.ndarray) -> None:
    """Raise InputError unless there are two edges or more and each lies above the one before."""
    if len(edges) < 2 or not (np.diff(edges) > 0.0).all():
        raise InputError(f"the bin edges {np.asarray(edges).tolist()} do not rise; give at least two, small to large")


def _ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Return the quotient, NaN where there is nothing to divide by."""
    return np.asarray(np.divide(above, below, out=np.full(np.shape(above), np.nan), where=below > 0))
