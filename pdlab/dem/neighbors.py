"""Who may touch whom: cell lists, one grid per size class, and the Verlet list made from them.

Every sphere carries an allowance, the way it may go before the list is stale; a fast one gets more.
The list holds each pair once, with the coarser class, and within a class with the smaller index.
"""

import math

import numpy as np

from pdlab.dem.jit import kernel


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
        cell[i] = offset[c] + (iz * along[c] + iy) * along[c] + ix
        start[cell[i] + 1] += 1
    for b in range(offset[classes]):
        start[b + 1] += start[b]
    items, fill = np.empty(n, np.int64), start[:-1].copy()
    for i in range(n):
        items[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return along, up, edge, bottom, far, offset, start, items


@kernel
def verlet_list(place, allowance, sizes, classes, width):  # type: ignore[no-untyped-def]
    """Return ``first`` (N + 1,) and ``neighbor`` (P,): all pairs that allowances may bring to touch.

    ``place`` (N, 4): x and y within [0, width), z, radius. ``allowance`` (N,), in length.
    """
    n = place.shape[0]
    reach = place[:, 3] + allowance
    along, up, edge, bottom, far, offset, start, items = make_grids(place, reach, sizes, classes, width)
    first, neighbor, pairs, half = np.zeros(n + 1, np.int64), np.empty(8 * n + 64, np.int32), 0, 0.5 * width
    for i in range(n):
        x, y, z, own = place[i, 0], place[i, 1], place[i, 2], sizes[i]
        for c in range(own, classes):
            r = reach[i] + far[c]
            z0 = max(0, math.floor((z - r - bottom[c]) / edge[c]))
            z1 = min(up[c] - 1, math.floor((z + r - bottom[c]) / edge[c]))
            x0, x1 = math.floor((x - r) / edge[c]), math.floor((x + r) / edge[c])
            y0, y1 = math.floor((y - r) / edge[c]), math.floor((y + r) / edge[c])
            x1, y1 = min(x1, x0 + along[c] - 1), min(y1, y0 + along[c] - 1)
            for iz in range(z0, z1 + 1):
                for iy in range(y0, y1 + 1):
                    row = offset[c] + (iz * along[c] + iy % along[c]) * along[c]
                    for ix in range(x0, x1 + 1):
                        cell = row + ix % along[c]
                        for q in range(start[cell], start[cell + 1]):
                            j = items[q]
                            if c == own and j <= i:
                                continue
                            dx, dy, dz = x - place[j, 0], y - place[j, 1], z - place[j, 2]
                            dx += (width if dx < -half else 0.0) - (width if dx > half else 0.0)
                            dy += (width if dy < -half else 0.0) - (width if dy > half else 0.0)
                            limit = reach[i] + reach[j]
                            if dx * dx + dy * dy + dz * dz < limit * limit:
                                if pairs == neighbor.size:
                                    grown = np.empty(2 * pairs, np.int32)
                                    grown[:pairs] = neighbor
                                    neighbor = grown
                                neighbor[pairs] = j
                                pairs += 1
        first[i + 1] = pairs
    return first, neighbor[:pairs].copy()


@kernel
def carry_springs(old_first, old_neighbor, old_touching, old_spring, first, neighbor):  # type: ignore[no-untyped-def]
    """Return ``touching`` (P,) and ``spring`` (P, 3) of a new list, the touching pairs' carried over."""
    touching, spring = np.zeros(neighbor.size, np.uint8), np.zeros((neighbor.size, 3))
    for i in range(first.size - 1):
        for k in range(old_first[i], old_first[i + 1]):
            if old_touching[k]:
                for m in range(first[i], first[i + 1]):
                    if neighbor[m] == old_neighbor[k]:
                        touching[m] = 1
                        spring[m, 0], spring[m, 1], spring[m, 2] = old_spring[k, 0], old_spring[k, 1], old_spring[k, 2]
                        break
    return touching, spring


def all_pairs(place: np.ndarray, allowance: np.ndarray, width: float) -> set[tuple[int, int]]:
    """Return by brute force the pairs (i < j) that ``verlet_list`` must hold: its twin for tests."""
    apart = place[:, None, :3] - place[None, :, :3]
    apart[..., :2] -= width * np.round(apart[..., :2] / width)
    reach = place[:, 3] + allowance
    near = (apart**2).sum(axis=-1) < (reach[:, None] + reach[None, :]) ** 2
    return {(int(i), int(j)) for i, j in np.argwhere(np.triu(near, 1))}
