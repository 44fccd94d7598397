"""What bounds a bed: the floor at z = 0, a closed cylinder or an open one, the laterally periodic box."""

import math
from typing import NamedTuple

import numpy as np

from pdlab.dem.contact import contact_force
from pdlab.dem.jit import inlined, kernel

FLOOR, SIDE, SLEEVE, LIP = range(4)


class WallList(NamedTuple):
    """Who may touch a wall: of sphere i the entries from ``first[i]`` to ``first[i + 1]``.

    ``wall`` (C,): FLOOR, SIDE, SLEEVE or LIP. ``spring`` (C, 3): the tangential spring's force on the sphere.
    """

    first: np.ndarray
    wall: np.ndarray
    spring: np.ndarray


class Container(NamedTuple):
    """The walls, which stand about the axis in the middle of the box; radii are infinite where there is none.

    ``side``: radius of a closed cylinder. ``sleeve``: of a thin one that is open below its rim, where spheres
    pass; it rises at ``speed``. ``base``: of the floor, beyond which spheres fall. ``lip``: height of the
    thin wall at the floor's edge, which goes down from there.
    """

    side: float = math.inf
    sleeve: float = math.inf
    speed: float = 0.0
    base: float = math.inf
    lip: float = 0.0


def no_walls(spheres: int) -> WallList:
    """Return a list in which no sphere is near a wall."""
    return WallList(np.zeros(spheres + 1, np.int64), np.zeros(0, np.uint8), np.zeros((0, 3)))


@kernel
def wall_list(place, allowance, width, container, rim, old):  # type: ignore[no-untyped-def]
    """Return the ``WallList`` of a bed, springs carried over from the ``old`` one.

    ``place`` (N, 4), ``allowance`` (N,). ``container``: a ``Container`` in the middle of the box of
    ``width``; ``rim``: height of its sleeve's, which only rises, away from all spheres.
    """
    n, count = place.shape[0], 0
    first, wall, spring = np.zeros(n + 1, np.int64), np.empty(4 * n, np.uint8), np.zeros((4 * n, 3))
    for i in range(n):
        reach = place[i, 3] + allowance[i]
        x, y = place[i, 0] - 0.5 * width, place[i, 1] - 0.5 * width
        for which in (FLOOR, SIDE, SLEEVE, LIP):
            if gap(which, math.sqrt(x * x + y * y), place[i, 2], container, rim) < reach:
                wall[count] = which
                for k in range(old.first[i], old.first[i + 1]):
                    if old.wall[k] == which:
                        spring[count] = old.spring[k]
                count += 1
        first[i + 1] = count
    return WallList(first, wall[:count].copy(), spring[:count].copy())


@inlined
def gap(which, off, z, container, rim):  # type: ignore[no-untyped-def]
    """Return how far a centre, ``off`` the axis and at height ``z``, is from a wall, the floor without its edge."""
    if which == FLOOR:
        return z
    if which == SIDE:
        return container.side - off
    out, over, _ = beside(which, off, z, container, rim)
    return math.sqrt(out * out + over * over)


@inlined
def beside(which, off, z, container, rim):  # type: ignore[no-untyped-def]
    """Return how far a centre is outward of and above the nearest point of a thin wall, and how fast that rises."""
    if which == SLEEVE:
        return off - container.sleeve, min(z - rim, 0.0), container.speed
    return off - container.base, max(z - container.lip, 0.0), 0.0


@inlined
def facing(which, x, y, z, container, rim):  # type: ignore[no-untyped-def]
    """Return the normal (3) from a wall to a centre at x, y from the axis, and the wall's speed upward."""
    off = math.sqrt(x * x + y * y)
    if which == FLOOR:
        return 0.0, 0.0, 1.0, 0.0
    if which == SIDE:
        return -x / off, -y / off, 0.0, 0.0
    out, over, up = beside(which, off, z, container, rim)
    apart = math.sqrt(out * out + over * over)
    return out / apart * (x / off), out / apart * (y / off), over / apart, up


@kernel
def wall_load(i, place, motion, law, near, width, container, rim, dt):  # type: ignore[no-untyped-def]
    """Return force (3) and torque (3) of the walls on sphere ``i``.

    ``place`` and ``motion`` flat, as in ``contact.eight_pairs``; ``law``: the walls' row of four for
    this sphere's species, its first number at ``law[0]``. The walls are rigid, and still but for a rising sleeve.
    A thin wall pushes from both of its sides, and from its edge.
    """
    p, m = 4 * i, 8 * i
    r = place[p + 3]
    fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(near.first[i], near.first[i + 1]):
        which, x, y, z = near.wall[k], place[p] - 0.5 * width, place[p + 1] - 0.5 * width, place[p + 2]
        off = math.sqrt(x * x + y * y)
        delta = r - gap(which, off, z, container, rim)
        if delta <= 0.0 or (which == FLOOR and off > container.base):
            near.spring[k, 0] = near.spring[k, 1] = near.spring[k, 2] = 0.0
            continue
        nx, ny, nz, up = facing(which, x, y, z, container, rim)
        wx, wy, wz = r * motion[m + 4], r * motion[m + 5], r * motion[m + 6]
        fn, gx, gy, gz, sx, sy, sz = contact_force(
            delta, nx, ny, nz,
            motion[m] - (wy * nz - wz * ny),
            motion[m + 1] - (wz * nx - wx * nz),
            motion[m + 2] - up - (wx * ny - wy * nx),
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
