"""Cells that spheres are put into one by one: one grid per size class, linked lists, periodic along x and y."""

import math
from typing import NamedTuple

import numpy as np

from pdlab.dem.jit import inlined, kernel


class Cells(NamedTuple):
    """Where the spheres lie that are placed already, found by place.

    ``width`` of the box. Of each of C size classes, shape (C,): ``largest`` radius, ``edge`` of a cell, cells
    ``along`` x and y, cells ``up``; ``offset`` (C + 1,): where its cells begin in ``head``, which names
    the last sphere put into each cell. ``chain`` (N,): the sphere put there before; -1 for none.
    ``sizes`` (N,): class of each sphere.
    """

    width: float
    largest: np.ndarray
    edge: np.ndarray
    along: np.ndarray
    up: np.ndarray
    offset: np.ndarray
    head: np.ndarray
    chain: np.ndarray
    sizes: np.ndarray


def empty_cells(radius: np.ndarray, sizes: np.ndarray, width: float, height: float) -> Cells:
    """Return cells for spheres of ``radius`` (N,) and size class ``sizes`` (N,), from 0 without a gap.

    The cells reach up to ``height``; what lies higher is in the uppermost ones.
    """
    largest = np.array([radius[sizes == c].max() for c in range(int(sizes.max()) + 1)])
    along = np.maximum(1, (width / (2.0 * largest)).astype(np.int64))
    edge = width / along
    up = np.maximum(1, np.ceil(height / edge)).astype(np.int64)
    offset = np.concatenate([[0], np.cumsum(along * along * up)]).astype(np.int64)
    head, chain = np.full(offset[-1], -1, np.int64), np.full(radius.size, -1, np.int64)
    return Cells(width, largest, edge, along, up, offset, head, chain, sizes.astype(np.int64))


@kernel
def put(cells, place, i):  # type: ignore[no-untyped-def]
    """Put sphere ``i``, at ``place[i]`` with x and y in [0, width), into its cell."""
    c = cells.sizes[i]
    edge, along = cells.edge[c], cells.along[c]
    ix, iy = min(int(place[i, 0] / edge), along - 1), min(int(place[i, 1] / edge), along - 1)
    iz = min(int(place[i, 2] / edge), cells.up[c] - 1)
    cell = cells.offset[c] + (iz * along + iy) * along + ix
    cells.chain[i] = cells.head[cell]
    cells.head[cell] = i


@kernel
def gather(cells, low, high, r, near):  # type: ignore[no-untyped-def]
    """Write to ``near`` (N,) which spheres one of radius ``r`` may touch; return how many.

    Its centre is anywhere between the corners ``low`` and ``high``, each x, y, z. All that may touch are found,
    and some that are too far.
    """
    found = 0
    for c in range(cells.along.size):
        edge, along, reach = cells.edge[c], cells.along[c], r + cells.largest[c]
        x0, x1 = math.floor((low[0] - reach) / edge), math.floor((high[0] + reach) / edge)
        y0, y1 = math.floor((low[1] - reach) / edge), math.floor((high[1] + reach) / edge)
        z0, z1 = math.floor((low[2] - reach) / edge), math.floor((high[2] + reach) / edge)
        x1, y1 = min(x1, x0 + along - 1), min(y1, y0 + along - 1)
        z0, z1 = min(max(z0, 0), cells.up[c] - 1), min(z1, cells.up[c] - 1)
        for iz in range(z0, z1 + 1):
            for iy in range(y0, y1 + 1):
                row = cells.offset[c] + (iz * along + iy % along) * along
                for ix in range(x0, x1 + 1):
                    j = cells.head[row + ix % along]
                    while j >= 0:
                        near[found] = j
                        found += 1
                        j = cells.chain[j]
    return found


@inlined
def apart(p, place, j, width):  # type: ignore[no-untyped-def]
    """Return the vector x, y, z to ``p`` from the image of sphere ``j`` that is next to it."""
    dx, dy = p[0] - place[j, 0], p[1] - place[j, 1]
    return (dx - width * math.floor(dx / width + 0.5), dy - width * math.floor(dy / width + 0.5), p[2] - place[j, 2])
