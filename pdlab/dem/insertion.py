"""A cloud of spheres that do not overlap: random sequential insertion, the largest first."""

import math

import numpy as np

from pdlab.dem.jit import kernel

ATTEMPTS = 20_000
"""Places tried for one sphere before the cloud is given up."""


@kernel
def cloud(radius, width, wall, bottom, top, attempts, rng):  # type: ignore[no-untyped-def]
    """Return places (N, 4) of spheres between the heights ``bottom`` and ``top``, and how many found one.

    ``radius`` (N,) falls or stays; places are uniform, laterally periodic, and inside the cylinder of
    radius ``wall`` in the box's middle, infinite where there is none. The cells hold the spheres by
    linked lists, one grid per factor of 1.5 in size.
    """
    n, height = radius.size, top - bottom
    place, chain = np.empty((n, 4)), np.full(n, -1, np.int64)
    classes = int(math.log(radius[0] / radius[n - 1]) / math.log(1.5) + 1e-9) + 1
    largest, along, up = np.zeros(classes), np.zeros(classes, np.int64), np.zeros(classes, np.int64)
    offset = np.zeros(classes + 1, np.int64)
    for c in range(classes):
        largest[c] = radius[0] / 1.5**c
        along[c] = max(1, int(width / (2.0 * largest[c])))
        up[c] = int(height / (width / along[c])) + 1
        offset[c + 1] = offset[c] + along[c] * along[c] * up[c]
    head = np.full(offset[classes], -1, np.int64)
    for i in range(n):
        r, found = radius[i], False
        for _ in range(attempts):
            x, y = rng.random() * width, rng.random() * width
            while math.hypot(x - 0.5 * width, y - 0.5 * width) + r > wall:
                x, y = rng.random() * width, rng.random() * width
            z = r + rng.random() * (height - 2.0 * r)
            if fits(x, y, z, r, place, width, largest, along, up, offset, head, chain):
                found = True
                break
        if not found:
            return place, i
        place[i, 0], place[i, 1], place[i, 2], place[i, 3] = x, y, z, r
        c = min(int(math.log(radius[0] / r) / math.log(1.5) + 1e-9), classes - 1)
        edge = width / along[c]
        cell = offset[c] + (int(z / edge) * along[c] + min(int(y / edge), along[c] - 1)) * along[c]
        cell += min(int(x / edge), along[c] - 1)
        chain[i] = head[cell]
        head[cell] = i
    place[:, 2] += bottom
    return place, n


@kernel
def fits(x, y, z, r, place, width, largest, along, up, offset, head, chain):  # type: ignore[no-untyped-def]
    """Return whether a sphere at (x, y, z) overlaps none of those already in the cells."""
    half = 0.5 * width
    for c in range(along.size):
        edge, reach = width / along[c], r + largest[c]
        z0, z1 = max(0, int((z - reach) / edge)), min(up[c] - 1, int((z + reach) / edge))
        x0, x1 = math.floor((x - reach) / edge), math.floor((x + reach) / edge)
        y0, y1 = math.floor((y - reach) / edge), math.floor((y + reach) / edge)
        x1, y1 = min(x1, x0 + along[c] - 1), min(y1, y0 + along[c] - 1)
        for iz in range(z0, z1 + 1):
            for iy in range(y0, y1 + 1):
                for ix in range(x0, x1 + 1):
                    cell = offset[c] + (iz * along[c] + iy % along[c]) * along[c] + ix % along[c]
                    j = head[cell]
                    while j >= 0:
                        dx, dy, dz = abs(x - place[j, 0]), abs(y - place[j, 1]), z - place[j, 2]
                        dx, dy = (width - dx if dx > half else dx), (width - dy if dy > half else dy)
                        if dx * dx + dy * dy + dz * dz < (r + place[j, 3]) ** 2:
                            return False
                        j = chain[j]
    return True
