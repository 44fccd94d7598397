"""Spheres put at random and never moved, the largest first: random sequential addition (Widom 1966) to its end.

Each sphere's centre is uniform over all places where it overlaps none. So that the last places are found, and
their absence is known, the box is cut into cubes; a cube that one sphere covers is left out, and the others are
halved when tries in them go on failing (after Zhang and Torquato 2013).
"""

import math

import numpy as np

from pdlab.dem.bed import Setup
from pdlab.dem.cells import apart, empty_cells, gather, put
from pdlab.dem.jit import kernel
from pdlab.dem.neighbors import size_classes
from pdlab.errors import ProtocolError

STEP = 0.001
"""How near to the densest box the one is that is taken, relative in the solid fraction."""
CUBE, FINEST = 1.5, 1e-9
"""Edge of the first cubes, and of those too small to be a place, in radii of the sphere."""


def random_placement(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 4) and species (N,) of spheres put at random into the lowest box that takes them all.

    x, y, z, radius in largest diameters, the largest first; periodic along x and y, between a floor and a lid, both
    hard: read the solid fraction in the middle half. The box's own is found to a thousandth of it; every box is
    filled anew, from the same seed. Raises ProtocolError for a cylinder.
    """
    if setup.cylinder:
        raise ProtocolError("spheres are put at random into a periodic box only; take the container 'periodic'")
    order = np.argsort(-setup.diameter, kind="stable")
    species = np.repeat(order, setup.count[order]).astype(np.int64)
    solids = float((setup.count * (0.5 * setup.diameter) ** 3).sum())
    low, high, middle, best = 0.0, 1.0, 1.0, np.empty((0, 4))
    while high - low > STEP * high:
        place = filled(setup, species, middle)
        if len(place) == species.size:
            low, best = middle, place
        else:
            high = middle
        taken = middle * float((place[:, 3] ** 3).sum()) / solids
        middle = 0.5 * (low + high) if low else max(taken - STEP, 0.5 * middle)
    return best, species


def filled(setup: Setup, species: np.ndarray, solid_fraction: float) -> np.ndarray:
    """Return the places (M, 4) of as many of the spheres, ``species`` (N,), as a box takes in their order.

    The box has the ``solid_fraction`` when all are in it. M is less than N when no place was left for one.
    """
    radius = 0.5 * setup.diameter[species]
    height = float((4.0 / 3.0 * math.pi * radius**3).sum()) / setup.area / solid_fraction
    cells = empty_cells(radius, size_classes(setup.diameter)[species], setup.width, height)
    rng = np.random.Generator(np.random.PCG64(setup.seed))
    place, placed, near = np.empty((radius.size, 4)), 0, np.empty(radius.size, np.int64)
    while placed < radius.size:
        r = float(radius[placed])
        last = placed + int((radius[placed:] == r).sum())
        placed = fill(place, placed, last, r, height, cells, near, rng)
        if placed < last:
            break
    return place[:placed]


@kernel
def fill(place, placed, last, r, height, cells, near, rng):  # type: ignore[no-untyped-def]
    """Put spheres ``placed`` to ``last``, all of radius ``r``, at random; return how many lie there then.

    They lie between 0 and ``height``. Fewer than ``last``: there is no place for a further one.
    """
    if height < 2.0 * r:
        return placed
    cubes, sides = first_cubes(cells.width, height - 2.0 * r, r)
    finest, count, failed = FINEST * r, cubes.shape[0], 0
    while placed < last and count and sides[0] > finest:
        k = int(rng.random() * count)
        p = (
            cubes[k, 0] + rng.random() * sides[0], cubes[k, 1] + rng.random() * sides[1],
            cubes[k, 2] + rng.random() * sides[2],
        )  # fmt: skip
        if is_free(p, r, place, cells, near):
            place[placed, 0], place[placed, 1], place[placed, 2], place[placed, 3] = p[0], p[1], p[2], r
            put(cells, place, placed)
            placed += 1
        else:
            failed += 1
            if is_covered(cubes[k], sides, r, place, cells, near):
                count -= 1
                cubes[k] = cubes[count]
        if failed > count:
            cubes, sides = halved(cubes, count, sides, r, place, cells, near)
            count, failed = cubes.shape[0], 0
    return placed


@kernel
def first_cubes(width, depth, r):  # type: ignore[no-untyped-def]
    """Return the lower corners (K, 3) and the sides (3,) of cubes, almost, in which centres may lie."""
    along, up = math.ceil(width / (CUBE * r)), max(1, math.ceil(depth / (CUBE * r)))
    sides, cubes, k = np.array([width / along, width / along, depth / up]), np.empty((along * along * up, 3)), 0
    for ix in range(along):
        for iy in range(along):
            for iz in range(up):
                cubes[k, 0], cubes[k, 1], cubes[k, 2] = ix * sides[0], iy * sides[1], r + iz * sides[2]
                k += 1
    return cubes, sides


@kernel
def halved(cubes, count, sides, r, place, cells, near):  # type: ignore[no-untyped-def]
    """Return the halves along all axes of the first ``count`` cubes that no sphere covers, and their sides."""
    half, halves, kept = 0.5 * sides, np.empty((8 * count, 3)), 0
    for k in range(count):
        for corner in range(8):
            for axis in range(3):
                halves[kept, axis] = cubes[k, axis] + (corner >> axis & 1) * half[axis]
            if not is_covered(halves[kept], half, r, place, cells, near):
                kept += 1
    return halves[:kept].copy(), half


@kernel
def is_free(p, r, place, cells, near):  # type: ignore[no-untyped-def]
    """Return whether a sphere at ``p`` overlaps none of those in the cells."""
    for k in range(gather(cells, p, p, r, near)):
        dx, dy, dz = apart(p, place, near[k], cells.width)
        if dx * dx + dy * dy + dz * dz < (r + place[near[k], 3]) ** 2:
            return False
    return True


@kernel
def is_covered(corner, sides, r, place, cells, near):  # type: ignore[no-untyped-def]
    """Return whether one sphere leaves a sphere of radius ``r`` no place in a cube: not in its farthest corner."""
    hx, hy, hz = 0.5 * sides[0], 0.5 * sides[1], 0.5 * sides[2]
    p = (corner[0] + hx, corner[1] + hy, corner[2] + hz)
    for k in range(gather(cells, p, p, r, near)):
        dx, dy, dz = apart(p, place, near[k], cells.width)
        if (abs(dx) + hx) ** 2 + (abs(dy) + hy) ** 2 + (abs(dz) + hz) ** 2 < (r + place[near[k], 3]) ** 2:
            return True
    return False
