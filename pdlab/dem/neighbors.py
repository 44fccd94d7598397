"""Who may touch whom: cell lists, one grid per size class, and the Verlet list made from them.

Every sphere carries an allowance, the way it may go before the list is stale; a fast one gets more.
The list holds each pair once, under the smaller index, in groups of eight.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from pdlab.dem.jit import alone_and_shared, kernel
from pdlab.dem.simd import PAIRS


class PairList(NamedTuple):
    """Pairs that may touch, in G groups of eight.

    The groups of a bed in P parts stand in 2 P + 1 chapters: the pairs within each part, those across the
    borders behind the parts 0, 2, 4 ..., then those behind 1, 3, 5 ..., and all others. Chapters of one
    kind share no sphere, but for the last. Each chapter's last group is filled up with a pair of no
    stiffness. ``owner``, ``neighbor``, ``kind`` (8 G,), unsigned: spheres i < j and their row in the law's
    table, whose last is the fill's. ``spring`` (24 G,): the tangential springs' forces on i, of each group
    x, y, z of the eight; (48 G,) with rolling resistance, whose springs' moments follow. ``touched`` (G,):
    whether any pair of the group touched in the last step. ``begin`` (2 P + 2,): each chapter's first group.
    """

    owner: np.ndarray
    neighbor: np.ndarray
    kind: np.ndarray
    spring: np.ndarray
    touched: np.ndarray
    begin: np.ndarray


def no_pairs() -> PairList:
    """Return an empty list."""
    index = np.zeros(0, np.uint32)
    return PairList(index, index, index, np.zeros(0), np.zeros(0, np.uint8), np.zeros(4, np.int64))


def size_classes(radius: np.ndarray) -> np.ndarray:
    """Return the size class of each species, shape (S,), coarsest first: one per factor of 1.5.

    ``radius``: shape (S,), any unit.
    """
    steps = np.floor(np.log(radius.max() / radius) / math.log(1.5) + 1e-9).astype(np.int64)
    return np.unique(steps, return_inverse=True)[1].astype(np.int64)


@kernel
def make_grids(place, reach, sizes, classes, width):  # type: ignore[no-untyped-def]
    """Sort the spheres into one grid per size class.

    ``reach`` (N,): radius and allowance. ``sizes`` (N,): class of each sphere. Returned: per class
    cells along x and y, cells along z, cell edge, bottom and largest reach (each (C,)), where its
    cells begin in ``start``; and ``start``, ``items``, the spheres cell by cell.
    """
    n = place.shape[0]
    along, up, offset = np.ones(classes, np.int64), np.ones(classes, np.int64), np.zeros(classes + 1, np.int64)
    edge, bottom, top, far = np.ones(classes), np.full(classes, np.inf), np.full(classes, -np.inf), np.zeros(classes)
    count, radius = np.zeros(classes, np.int64), np.zeros(classes)
    for i in range(n):
        c = sizes[i]
        count[c] += 1
        radius[c] = max(radius[c], place[i, 3])
        far[c] = max(far[c], reach[i])
        bottom[c] = min(bottom[c], place[i, 2])
        top[c] = max(top[c], place[i, 2])
    for c in range(classes):
        if count[c]:
            # a sparse class gets cells no finer than about one sphere each
            room = width * width * (top[c] - bottom[c] + 2.0 * radius[c]) / count[c]
            wanted = max(2.2 * radius[c], 0.8 * room ** (1.0 / 3.0))
            along[c] = max(1, int(width / wanted))
            edge[c] = width / along[c]
            up[c] = int((top[c] - bottom[c]) / edge[c]) + 1
        offset[c + 1] = offset[c] + along[c] * along[c] * up[c]
    start, cell = np.zeros(offset[classes] + 1, np.int64), np.empty(n, np.int64)
    for i in range(n):
        c = sizes[i]
        ix = min(int(place[i, 0] / edge[c]), along[c] - 1)
        iy = min(int(place[i, 1] / edge[c]), along[c] - 1)
        iz = int((place[i, 2] - bottom[c]) / edge[c])
        cell[i] = offset[c] + (ix * along[c] + iy) * up[c] + iz  # upward cells follow each other
        start[cell[i] + 1] += 1
    for b in range(offset[classes]):
        start[b + 1] += start[b]
    items, fill = np.empty(n, np.int64), start[:-1].copy()
    for i in range(n):
        items[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return along, up, edge, bottom, far, offset, start, items


@kernel
def search(begin, end, sorted_place, rank, sizes, grids, width, owner, neighbor, at, limit):  # type: ignore[no-untyped-def]
    """Write the pairs of spheres ``begin`` to ``end`` with those later in the cells; return how many.

    ``sorted_place`` (N, 4): x, y, z and reach in the order of the cells, in which sphere i is
    ``rank[i]``-th. Pairs go to ``owner`` and ``neighbor`` from ``at`` on, at most ``limit`` of them; all
    are counted.
    """
    along, up, edge, bottom, far, offset, start, items = grids
    pairs, half, classes = 0, 0.5 * width, along.size
    for i in range(begin, end):
        p = rank[i]
        x, y, z, reach = sorted_place[p, 0], sorted_place[p, 1], sorted_place[p, 2], sorted_place[p, 3]
        for c in range(sizes[i], classes):
            r = reach + far[c]
            z0 = max(0, math.floor((z - r - bottom[c]) / edge[c]))
            z1 = min(up[c] - 1, math.floor((z + r - bottom[c]) / edge[c]))
            x0, x1 = math.floor((x - r) / edge[c]), math.floor((x + r) / edge[c])
            y0, y1 = math.floor((y - r) / edge[c]), math.floor((y + r) / edge[c])
            x1, y1 = min(x1, x0 + along[c] - 1), min(y1, y0 + along[c] - 1)
            if z1 < z0:
                continue
            for ix in range(x0, x1 + 1):
                wx = ix + along[c] if ix < 0 else (ix - along[c] if ix >= along[c] else ix)
                for iy in range(y0, y1 + 1):
                    wy = iy + along[c] if iy < 0 else (iy - along[c] if iy >= along[c] else iy)
                    row = offset[c] + (wx * along[c] + wy) * up[c]
                    for q in range(max(start[row + z0], p + 1), start[row + z1 + 1]):
                        dx, dy, dz = x - sorted_place[q, 0], y - sorted_place[q, 1], z - sorted_place[q, 2]
                        dx += (width if dx < -half else 0.0) - (width if dx > half else 0.0)
                        dy += (width if dy < -half else 0.0) - (width if dy > half else 0.0)
                        near = reach + sorted_place[q, 3]
                        if dx * dx + dy * dy + dz * dz < near * near:
                            if pairs < limit:
                                j = items[q]
                                owner[at + pairs], neighbor[at + pairs] = min(i, j), max(i, j)
                            pairs += 1
    return pairs


def _search_shares(  # type: ignore[no-untyped-def]
    shares, sorted_place, rank, sizes, grids, width, owner, neighbor, room, found
):
    """Search in ``shares`` of the spheres, each writing from ``share * room`` on; count them in ``found``."""
    n = sorted_place.shape[0]
    for share in prange(shares):
        begin, end = share * n // shares, (share + 1) * n // shares
        found[share] = search(begin, end, sorted_place, rank, sizes, grids, width, owner, neighbor, share * room, room)


search_alone, search_shared = alone_and_shared(_search_shares)
"""The same search on one thread and on several."""


@kernel
def all_found(place, allowance, sizes, classes, width, guess, threads):  # type: ignore[no-untyped-def]
    """Return ``owner`` and ``neighbor`` (P,): all pairs that allowances may bring to touch.

    ``place`` (N, 4): x and y within [0, width), z, radius. ``allowance`` (N,), in length. ``guess``:
    how many pairs there may be. ``threads``: None, or in how many shares to search at once.
    """
    n = place.shape[0]
    grids = make_grids(place, place[:, 3] + allowance, sizes, classes, width)
    items = grids[7]
    sorted_place, rank = np.empty((n, 4)), np.empty(n, np.int64)
    for p in range(n):
        i = items[p]
        sorted_place[p, 0], sorted_place[p, 1], sorted_place[p, 2] = place[i, 0], place[i, 1], place[i, 2]
        sorted_place[p, 3], rank[i] = place[i, 3] + allowance[i], p
    count = 1 if threads is None else threads
    found, room = np.zeros(count, np.int64), guess // count + 64
    while True:
        owner, neighbor = np.empty(count * room, np.uint32), np.empty(count * room, np.uint32)
        if threads is None:
            search_alone(1, sorted_place, rank, sizes, grids, width, owner, neighbor, room, found)
        else:
            search_shared(count, sorted_place, rank, sizes, grids, width, owner, neighbor, room, found)
        if found.max() <= room:
            break
        room = found.max()
    total = found[0]
    for part in range(1, count):
        for k in range(found[part]):
            owner[total + k], neighbor[total + k] = owner[part * room + k], neighbor[part * room + k]
        total += found[part]
    return owner[:total], neighbor[:total]


@kernel
def chapter(i, j, n, parts):  # type: ignore[no-untyped-def]
    """Return the chapter of a pair of ``n`` spheres, of which part p holds those from n p/P on."""
    p, q = part_of(i, n, parts), part_of(j, n, parts)
    if p == q:
        return p
    if abs(p - q) != 1 and abs(p - q) != parts - 1:
        return 2 * parts
    border = min(p, q) if abs(p - q) == 1 else parts - 1
    return parts + border // 2 + (parts // 2 if border % 2 else 0)


@kernel
def part_of(i, n, parts):  # type: ignore[no-untyped-def]
    """Return the part of sphere ``i``: the p with n p//P <= i < n (p + 1)//P."""
    return ((i + 1) * parts - 1) // n


@kernel
def verlet_list(place, allowance, species, kinds, sizes, classes, width, parts, springs, old, threads):  # type: ignore[no-untyped-def]
    """Return the ``PairList`` of a bed, the springs of the ``old`` one carried over.

    ``species`` (N,), of ``kinds`` kinds; ``parts``: 1, or an even number; ``springs`` of each pair: 1, or 2
    with rolling resistance; the others as in ``all_found``.
    """
    n, guess = place.shape[0], old.owner.size + old.owner.size // 8
    owner, neighbor = all_found(place, allowance, sizes, classes, width, guess, threads)
    which, count = np.empty(owner.size, np.int64), np.zeros(2 * parts + 1, np.int64)
    for k in range(owner.size):
        which[k] = chapter(np.int64(owner[k]), np.int64(neighbor[k]), n, parts)
        count[which[k]] += 1
    begin = np.zeros(2 * parts + 2, np.int64)
    for c in range(2 * parts + 1):
        begin[c + 1] = begin[c] + (count[c] + PAIRS - 1) // PAIRS
    groups, fill = begin[-1], PAIRS * begin
    first, second, kind = (
        np.empty(PAIRS * groups, np.uint32), np.empty(PAIRS * groups, np.uint32), np.empty(PAIRS * groups, np.uint32),
    )  # fmt: skip
    for k in range(owner.size):
        at = fill[which[k]]
        first[at], second[at], kind[at] = owner[k], neighbor[k], species[owner[k]] * kinds + species[neighbor[k]]
        fill[which[k]] += 1
    for c in range(2 * parts + 1):
        for at in range(fill[c], PAIRS * begin[c + 1]):
            first[at], second[at], kind[at] = first[fill[c] - 1], second[fill[c] - 1], kinds * kinds
    new = PairList(first, second, kind, np.zeros(3 * springs * PAIRS * groups), np.zeros(groups, np.uint8), begin)
    carry_springs(n, kinds * kinds, springs, old, new)
    return new


@kernel
def carry_springs(spheres, fill, springs, old, new):  # type: ignore[no-untyped-def]
    """Copy the springs of every pair that both lists hold from ``old`` to ``new``, ``springs`` of each.

    ``fill``: the kind of pairs that only fill a group up.
    """
    start, strained = np.zeros(spheres + 1, np.int64), np.zeros(old.owner.size, np.bool_)
    size, new_size = 3 * PAIRS * old.touched.size, 3 * PAIRS * new.touched.size
    for g in range(old.touched.size):
        if old.touched[g]:
            for k in range(PAIRS * g, PAIRS * g + PAIRS):
                s = 3 * PAIRS * g + k % PAIRS
                for axis in range(0, 3 * PAIRS, PAIRS):
                    for which in range(springs):
                        strained[k] |= old.spring[which * size + s + axis] != 0.0
                start[old.owner[k] + 1] += strained[k]
    for i in range(spheres):
        start[i + 1] += start[i]
    held, end = np.empty(start[spheres], np.int64), start[:-1].copy()
    for k in range(old.owner.size):
        if strained[k]:
            held[end[old.owner[k]]] = k
            end[old.owner[k]] += 1
    for k in range(new.owner.size):
        for h in range(start[new.owner[k]], start[new.owner[k] + 1]):
            m = held[h]
            if old.neighbor[m] == new.neighbor[k] and new.kind[k] != fill:
                a, b = 3 * PAIRS * (m // PAIRS) + m % PAIRS, 3 * PAIRS * (k // PAIRS) + k % PAIRS
                for axis in range(0, 3 * PAIRS, PAIRS):
                    for which in range(springs):
                        new.spring[which * new_size + b + axis] = old.spring[which * size + a + axis]
                new.touched[k // PAIRS] = 1
                break


def all_pairs(place: np.ndarray, allowance: np.ndarray, width: float) -> set[tuple[int, int]]:
    """Return by brute force the pairs (i < j) that ``verlet_list`` must hold: its twin for tests."""
    apart = place[:, None, :3] - place[None, :, :3]
    apart[..., :2] -= width * np.round(apart[..., :2] / width)
    reach = place[:, 3] + allowance
    near = (apart**2).sum(axis=-1) < (reach[:, None] + reach[None, :]) ** 2
    return {(int(i), int(j)) for i, j in np.argwhere(np.triu(near, 1))}
