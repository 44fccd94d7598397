"""A bed by geometry alone: spheres fall one by one and roll to rest.

A falling sphere goes down on the steepest way that those before it leave open (Visscher and Bolsterli 1972):
straight down, along a meridian of one sphere, along the circle on which it touches two. Each move is an arc whose
end has a closed form: where a further sphere is touched, where one is left, or the floor. It rests on the floor
or on three spheres whose triangle its centre lies above, and never moves again.
"""

import math

import numpy as np

from pdlab.dem.bed import Setup
from pdlab.dem.cells import apart, empty_cells, gather, put
from pdlab.dem.jit import inlined, kernel
from pdlab.dem.neighbors import size_classes
from pdlab.errors import ProtocolError, RunDiverged

NARROWEST = 4.0
"""Least width of the box, in largest diameters: on no arc does a sphere meet two images of another."""
TOUCH, ALONG = 1e-10, 1e-12
"""Gap that counts as a contact, in largest diameters; approach per way that counts as none."""
STRIDE, MOVES, REPEATS = 1.0, 10_000, 100
"""Height that a fall is searched in at once; moves of one sphere, and drops of it, before it is given up."""
DOWN, UP, EAST = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)


def drop_and_roll(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 4) and species (N,) of spheres dropped one by one in random order, at random x and y.

    x, y, z, radius in largest diameters, periodic along x and y, in the order of their fall. A sphere that meets a tie
    which rounding cannot tell is dropped again elsewhere. Raises ProtocolError for a cylinder and for a box
    narrower than four largest diameters, RunDiverged when a sphere does not come to rest.
    """
    _check_box(setup)
    rng = np.random.Generator(np.random.PCG64(setup.seed))
    species = rng.permutation(np.repeat(np.arange(setup.count.size), setup.count)).astype(np.int64)
    radius, sizes = 0.5 * setup.diameter[species], size_classes(setup.diameter)[species]
    place, placed, _ = pile(radius, empty_cells(radius, sizes, setup.width, setup.cloud_height), rng)
    if placed < species.size:
        raise RunDiverged(f"sphere {placed + 1} of {species.size} found no rest in {REPEATS} drops; take another seed")
    return place, species


def _check_box(setup: Setup) -> None:
    if setup.cylinder:
        raise ProtocolError("spheres fall and roll in a periodic box only; take the container 'periodic'")
    if setup.width < NARROWEST * float(setup.diameter.max()):
        raise ProtocolError(
            f"a box {setup.width:g} wide is narrower than {NARROWEST:g} largest diameters: a rolling sphere would meet "
            "two images of another; take a wider one"
        )


@kernel
def pile(radius, cells, rng):  # type: ignore[no-untyped-def]
    """Return places (N, 4) of spheres of ``radius`` (N,) that fall in this order, how many rest, and drops anew."""
    n, width, top, anew = radius.size, cells.width, 0.0, 0
    place, near, touched, normal = np.empty((n, 4)), np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3))
    for i in range(n):
        r, rests, p = radius[i], False, UP
        for _ in range(REPEATS):
            start = (rng.random() * width, rng.random() * width, top + r)
            rests, p = settled(start, r, place, cells, near, touched, normal)
            if rests:
                break
            anew += 1
        if not rests:
            return place, i, anew
        place[i, 0], place[i, 1], place[i, 2], place[i, 3] = p[0], p[1], p[2], r
        top = max(top, p[2] + r)
        put(cells, place, i)
    return place, n, anew


@kernel
def settled(start, r, place, cells, near, touched, normal):  # type: ignore[no-untyped-def]
    """Return whether a sphere dropped at ``start`` comes to rest, and where."""
    p, found = fall(start, r, place, cells, near)
    for _ in range(MOVES):
        touching, deepest = contacts(p, r, place, near, found, cells.width, touched, normal)
        if deepest > TOUCH:
            return False, p
        if p[2] - r < TOUCH:
            return True, p
        number, a, b = carriers(normal, touching)
        if number == 3:
            return True, p
        if number == 0:
            p, found = fall(p, r, place, cells, near)
        else:
            arc = arc_down(p, r, place, touched[a], touched[b], cells.width)
            p, found = roll(arc, r, place, touched[a], touched[b], cells, near)
            p = (p[0] % cells.width % cells.width, p[1] % cells.width % cells.width, p[2])
    return False, p


@kernel
def fall(p, r, place, cells, near):  # type: ignore[no-untyped-def]
    """Return where a sphere falling from ``p`` touches first, the floor or another, and how many are ``near``."""
    x, y, z = p
    while True:
        bottom, highest = max(r, z - STRIDE), -1.0
        found = gather(cells, (x, y, bottom), (x, y, z), r, near)
        for k in range(found):
            dx, dy, dz = apart((x, y, z), place, near[k], cells.width)
            left = (r + place[near[k], 3]) ** 2 - dx * dx - dy * dy
            if dz > 0.0 and left > 0.0:
                touch = z - dz + math.sqrt(left)
                if touch <= z:  # else it has been left at its equator
                    highest = max(highest, touch)
        if highest >= bottom or bottom == r:
            return (x, y, max(highest, bottom)), found
        z = bottom


@kernel
def contacts(p, r, place, near, found, width, touched, normal):  # type: ignore[no-untyped-def]
    """Write which of the ``found`` spheres ``near`` one at ``p`` touches, and the normals from them to it.

    Returned: how many, and the deepest overlap. They stand in rising order, whatever the order of the cells.
    """
    count, deepest = 0, 0.0
    for k in range(found):
        j = near[k]
        d = apart(p, place, j, width)
        length = math.sqrt(dot(d, d))
        gap = length - r - place[j, 3]
        deepest = max(deepest, -gap)
        if gap < TOUCH:
            at = count
            while at > 0 and touched[at - 1] > j:
                touched[at], normal[at] = touched[at - 1], normal[at - 1]
                at -= 1
            touched[at] = j
            normal[at, 0], normal[at, 1], normal[at, 2] = d[0] / length, d[1] / length, d[2] / length
            count += 1
    return count, deepest


@kernel
def carriers(normal, touching):  # type: ignore[no-untyped-def]
    """Return how many contacts hold a sphere, 0 to 3, and the one or two along which it goes down.

    ``normal`` (K, 3) of the ``touching``. It goes along gravity less what the contacts take of it, the
    projection of gravity on the ways into none; held by three, it rests.
    """
    if is_open(DOWN, normal, touching):
        return 0, 0, 0
    for a in range(touching):
        na = (normal[a, 0], normal[a, 1], normal[a, 2])
        if na[2] > 0.0 and is_open(ahead(DOWN, na[2], na), normal, touching):
            return 1, a, a
    for a in range(touching):
        na = (normal[a, 0], normal[a, 1], normal[a, 2])
        for b in range(a + 1, touching):
            nb = (normal[b, 0], normal[b, 1], normal[b, 2])
            c, way = dot(na, nb), cross(na, nb)
            way = way if way[2] < 0.0 else (-way[0], -way[1], -way[2])
            both_carry = na[2] >= c * nb[2] and nb[2] >= c * na[2]
            if both_carry and is_open(way, normal, touching):
                return 2, a, b
    return 3, 0, 0


@kernel
def is_open(way, normal, touching):  # type: ignore[no-untyped-def]
    """Return whether a way leads into none of the contacts."""
    approach = 0.0
    for k in range(touching):
        approach = max(approach, -way[0] * normal[k, 0] - way[1] * normal[k, 1] - way[2] * normal[k, 2])
    return approach <= ALONG * math.sqrt(dot(way, way))


@kernel
def arc_down(p, r, place, i, j, width):  # type: ignore[no-untyped-def]
    """Return the arc on which a sphere at ``p`` goes down sphere ``i``, or down both ``i`` and ``j``.

    Centre, radius, the unit vectors up and forward, the angles from up at its beginning and end: the floor, or where
    the sphere is left on its equator, or one of the two has no more to carry.
    """
    di, dj = apart(p, place, i, width), apart(p, place, j, width)
    si, sj, zi, zj = r + place[i, 3], r + place[j, 3], p[2] - di[2], p[2] - dj[2]
    if i == j:
        axis, along, end_z = cross(UP, di), 0.0, zi
        axis = unit(axis) if dot(axis, axis) > 0.0 else EAST  # right on its top, all ways are alike
    else:
        axis = unit(ahead(di, -1.0, dj))
        along, c = dot(di, axis), dot(di, dj) / (si * sj)  # c: cosine between the normals, the same all along
        end_z = -math.inf
        if 1.0 / si > c / sj:
            end_z = max(end_z, (zi / si - c * zj / sj) / (1.0 / si - c / sj))
        if 1.0 / sj > c / si:
            end_z = max(end_z, (zj / sj - c * zi / si) / (1.0 / sj - c / si))
    radius = math.sqrt(si * si - along * along)
    arm = ahead(di, -along, axis)
    centre, up = ahead(p, -1.0, arm), unit(ahead(UP, -axis[2], axis))
    forward = cross(axis, up)
    if dot(arm, forward) < 0.0:
        forward = (-forward[0], -forward[1], -forward[2])
    begin, cosine = math.atan2(dot(arm, forward), dot(arm, up)), (max(end_z, r) - centre[2]) / (radius * up[2])
    end = max(begin, math.acos(min(1.0, max(-1.0, cosine))))  # it may begin where it ends, up to rounding
    return centre, radius, up, forward, begin, end


@kernel
def roll(arc, r, place, i, j, cells, near):  # type: ignore[no-untyped-def]
    """Return where a sphere on an arc about ``i`` and ``j`` touches another, or its end, and how many are ``near``."""
    centre, radius, up, forward, begin, end = arc
    found = gather(cells, *corners(arc), r, near)
    turn = end - begin
    for k in range(found):
        m = near[k]
        if m in (i, j):
            continue
        d, s = apart(centre, place, m, cells.width), r + place[m, 3]
        # on the arc the square distance less s² is mean + cosine cos(angle) + sine sin(angle)
        mean = dot(d, d) + radius * radius - s * s
        cosine, sine = 2.0 * radius * dot(d, up), 2.0 * radius * dot(d, forward)
        swing = math.hypot(cosine, sine)
        if abs(mean) < swing:
            enter = (math.atan2(sine, cosine) + math.acos(-mean / swing) - begin) % (2.0 * math.pi)
            turn = min(turn, enter)
    return on_arc(arc, begin + turn), found


@kernel
def corners(arc):  # type: ignore[no-untyped-def]
    """Return two corners of a box about an arc."""
    centre, radius, up, forward, begin, end = arc
    first, last, across = on_arc(arc, begin), on_arc(arc, end), cross(up, forward)
    wide = radius * math.sqrt(max(0.0, 1.0 - across[0] * across[0]))
    deep = radius * math.sqrt(max(0.0, 1.0 - across[1] * across[1]))
    return (centre[0] - wide, centre[1] - deep, last[2]), (centre[0] + wide, centre[1] + deep, first[2])


@inlined
def on_arc(arc, angle):  # type: ignore[no-untyped-def]
    """Return the point of an arc at an angle from up."""
    centre, radius, up, forward = arc[0], arc[1], arc[2], arc[3]
    return ahead(ahead(centre, radius * math.cos(angle), up), radius * math.sin(angle), forward)


@inlined
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):  # type: ignore[no-untyped-def]
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def ahead(p, far, way):  # type: ignore[no-untyped-def]
    """Return the point so far from ``p`` along a way."""
    return (p[0] + far * way[0], p[1] + far * way[1], p[2] + far * way[2])


@inlined
def unit(a):  # type: ignore[no-untyped-def]
    """Return the vector's direction."""
    length = math.sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length)
