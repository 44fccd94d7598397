"""What bounds a bed: the floor at z = 0, the side of a cylinder, the laterally periodic box."""

import math
from typing import NamedTuple

import numpy as np

from pdlab.dem.contact import contact_force
from pdlab.dem.jit import kernel

FLOOR, SIDE = 0, 1


class WallList(NamedTuple):
    """Who may touch a wall: of sphere i the entries from ``first[i]`` to ``first[i + 1]``.

    ``wall`` (C,): FLOOR or SIDE. ``spring`` (C, 3): the tangential spring's force on the sphere.
    """

    first: np.ndarray
    wall: np.ndarray
    spring: np.ndarray


def no_walls(spheres: int) -> WallList:
    """Return a list in which no sphere is near a wall."""
    return WallList(np.zeros(spheres + 1, np.int64), np.zeros(0, np.uint8), np.zeros((0, 3)))


@kernel
def wall_list(place, allowance, width, radius, old):  # type: ignore[no-untyped-def]
    """Return the ``WallList`` of a bed, springs carried over from the ``old`` one.

    ``place`` (N, 4), ``allowance`` (N,). ``radius``: of the cylinder whose axis stands in the middle of
    the box of ``width``; infinite where there is none.
    """
    n, count = place.shape[0], 0
    first, wall, spring = np.zeros(n + 1, np.int64), np.empty(2 * n, np.uint8), np.zeros((2 * n, 3))
    for i in range(n):
        reach = place[i, 3] + allowance[i]
        x, y = place[i, 0] - 0.5 * width, place[i, 1] - 0.5 * width
        for which in (FLOOR, SIDE):
            gap = place[i, 2] if which == FLOOR else radius - math.sqrt(x * x + y * y)
            if gap < reach:
                wall[count] = which
                for k in range(old.first[i], old.first[i + 1]):
                    if old.wall[k] == which:
                        spring[count] = old.spring[k]
                count += 1
        first[i + 1] = count
    return WallList(first, wall[:count].copy(), spring[:count].copy())


@kernel
def wall_load(i, place, motion, law, near, width, radius, dt):  # type: ignore[no-untyped-def]
    """Return force (3) and torque (3) of the walls on sphere ``i``.

    ``place`` and ``motion`` flat, as in ``contact.eight_pairs``; ``law``: the walls' row of four for
    this sphere's species, its first number at ``law[0]``. The walls are rigid and still.
    """
    p, m = 4 * i, 8 * i
    r = place[p + 3]
    fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(near.first[i], near.first[i + 1]):
        nx, ny, nz, delta = 0.0, 0.0, 1.0, r - place[p + 2]
        if near.wall[k] == SIDE:
            x, y = place[p] - 0.5 * width, place[p + 1] - 0.5 * width
            off = math.sqrt(x * x + y * y)
            delta = r - (radius - off)
            nx, ny, nz = -x / off, -y / off, 0.0
        if delta <= 0.0:
            near.spring[k, 0] = near.spring[k, 1] = near.spring[k, 2] = 0.0
            continue
        wx, wy, wz = r * motion[m + 4], r * motion[m + 5], r * motion[m + 6]
        fn, gx, gy, gz, sx, sy, sz = contact_force(
            delta, nx, ny, nz,
            motion[m] - (wy * nz - wz * ny),
            motion[m + 1] - (wz * nx - wx * nz),
            motion[m + 2] - (wx * ny - wy * nx),
            near.spring[k, 0], near.spring[k, 1], near.spring[k, 2],
            law[0], law[1], law[2], dt,
        )  # fmt: skip
        near.spring[k, 0], near.spring[k, 1], near.spring[k, 2] = sx, sy, sz
        tx, ty, tz = tx + r * (gy * nz - gz * ny), ty + r * (gz * nx - gx * nz), tz + r * (gx * ny - gy * nx)
        fx, fy, fz = fx + gx + fn * nx, fy + gy + fn * ny, fz + gz + fn * nz
    return fx, fy, fz, tx, ty, tz


@kernel
def wrap(place, width):  # type: ignore[no-untyped-def]
    """Bring every sphere's x and y back into [0, width)."""
    for i in range(place.shape[0]):
        for axis in range(2):
            while place[i, axis] < 0.0:
                place[i, axis] += width
            while place[i, axis] >= width:
                place[i, axis] -= width
