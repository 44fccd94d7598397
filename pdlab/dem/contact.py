"""Force and torque of one contact, and of eight at once: linear spring and dashpot, slip, rolling.

The law is that of Cundall and Strack (1979). The normal force is cut at zero, so the restitution
follows Schwager and Pöschel (2007). Rolling resistance, off by default, is the elastic-plastic spring
without dashpot of Ai, Chen, Rotter and Ooi (2011), type C.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from pdlab.dem.jit import inlined, kernel
from pdlab.dem.simd import (
    PAIRS,
    across,
    add_rows,
    along,
    any_below,
    choose,
    fourth,
    load_lane,
    nearest,
    quad,
    repeat,
    root,
    rounded,
    rows,
    spread_lane,
    store,
)

KN, GN, MU, ROLLING = range(4)
"""Columns of a law table: normal stiffness and damping, friction and rolling friction coefficients."""

TANGENTIAL_STIFFNESS = 2.0 / 7.0
TANGENTIAL_DAMPING = 0.5
ROLLING_STIFFNESS = 2.25
"""k_r = 2.25 k_n μ_r² R_eff² (Ai et al. 2011)."""


def restitution(zeta: float) -> float:
    """Return the restitution of a binary bounce at damping ratio ``zeta`` [-].

    Source: Schwager and Pöschel (2007): the contact ends when the force, not the overlap, is zero.
    """
    root = math.sqrt(1.0 - zeta * zeta)
    return math.exp(-zeta / root * (math.pi - 2.0 * math.asin(zeta)))


def damping_ratio(wanted: float) -> float:
    """Return the damping ratio [-] whose bounce has the restitution ``wanted``, in [0.14, 1].

    Less than exp(-2) no dashpot below critical damping gives.
    """
    if wanted == 1.0:
        return 0.0
    return float(brentq(lambda zeta: restitution(zeta) - wanted, 0.0, 0.999, xtol=1e-14))


PAIR_FRICTION: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "minimum": np.minimum,
    "mean": lambda one, other: np.asarray(0.5 * (one + other)),
    "geometric_mean": lambda one, other: np.asarray(np.sqrt(one * other)),
}
"""Friction between two species from theirs."""


def law_tables(
    diameter: np.ndarray,
    mass: np.ndarray,
    friction: np.ndarray,
    rolling: np.ndarray,
    wall_friction: float,
    modulus: float,
    zeta: float,
    pair_friction: str = "minimum",
) -> tuple[np.ndarray, np.ndarray]:
    """Return the contact parameters of every pair of species and of every species at a wall.

    ``diameter``, ``mass``, ``friction``, ``rolling``: shape (S,), reduced units. ``modulus``: the
    contact modulus E, force per area. The tables have shapes (S, S, 4) and (S, 4), columns ``KN`` to
    ``ROLLING``. Springs k_i = 2 E d_i act in series between spheres; a wall is rigid and does not
    resist rolling. Between two aggregates the smaller coefficients act; of friction the minimum, mean or
    geometric_mean as ``pair_friction`` says.
    """
    spring = 2.0 * modulus * diameter
    kn = spring[:, None] * spring[None, :] / (spring[:, None] + spring[None, :])
    meff = mass[:, None] * mass[None, :] / (mass[:, None] + mass[None, :])
    mu = PAIR_FRICTION[pair_friction](friction[:, None], friction[None, :])
    mu_r = np.minimum(rolling[:, None], rolling[None, :])
    walls = _law(spring, mass, np.minimum(friction, wall_friction), np.zeros_like(rolling), zeta)
    return _law(kn, meff, mu, mu_r, zeta), walls


def _law(kn: np.ndarray, meff: np.ndarray, mu: np.ndarray, mu_r: np.ndarray, zeta: float) -> np.ndarray:
    return np.stack([kn, 2.0 * zeta * np.sqrt(kn * meff), mu, mu_r], axis=-1)


def collision_time(kn: np.ndarray, meff: np.ndarray, zeta: float) -> np.ndarray:
    """Return the half period π/(ω√(1−ζ²)) of the damped contact spring, shape of ``kn``, in time."""
    return np.asarray(math.pi / (np.sqrt(kn / meff) * math.sqrt(1.0 - zeta * zeta)))


@inlined
def shortened(x, y, z, limit):  # type: ignore[no-untyped-def]
    """Return a vector cut to the length ``limit`` where it is longer, and its squares to tell where."""
    square, most = x * x + y * y + z * z, limit * limit
    scale = choose(most, square, limit / root(square), 1.0 + 0.0 * limit)
    return scale * x, scale * y, scale * z, most, square


@inlined
def contact_force(delta, nx, ny, nz, vx, vy, vz, sx, sy, sz, kn, gn, mu, dt):  # type: ignore[no-untyped-def]
    """Return normal force, tangential force (3) and the force of the tangential spring (3).

    Floats for one contact, lanes for eight. ``n`` points from j to i, ``v`` is the velocity of i's
    surface against j's at the contact, ``s`` the spring's force on i carried along from the step
    before: kept in the contact's plane, and shortened on slip to what it may carry.
    """
    vn = vx * nx + vy * ny + vz * nz
    nothing = 0.0 * vn
    pushing = kn * delta - gn * vn
    fn = choose(nothing, pushing, pushing, nothing)
    tx, ty, tz = vx - vn * nx, vy - vn * ny, vz - vn * nz
    out = sx * nx + sy * ny + sz * nz
    stretch, drag = (-TANGENTIAL_STIFFNESS * dt) * kn, -TANGENTIAL_DAMPING * gn
    sx, sy, sz = sx + (stretch * tx - out * nx), sy + (stretch * ty - out * ny), sz + (stretch * tz - out * nz)
    fx, fy, fz, most, square = shortened(sx + drag * tx, sy + drag * ty, sz + drag * tz, mu * fn)
    sx = choose(most, square, fx - drag * tx, sx)
    sy = choose(most, square, fy - drag * ty, sy)
    sz = choose(most, square, fz - drag * tz, sz)
    return fn, fx, fy, fz, sx, sy, sz


@inlined
def rolling_moment(fn, nx, ny, nz, wx, wy, wz, qx, qy, qz, kn, mu_r, reff, dt):  # type: ignore[no-untyped-def]
    """Return the moment (3) by which a contact resists rolling, on i, which is also its spring's.

    ``w``: angular velocity of i less that of j; its part along ``n`` is twisting and meets nothing.
    ``q``: the moment carried along; ``reff``: R_i R_j/(R_i + R_j).
    """
    wn = wx * nx + wy * ny + wz * nz
    out = qx * nx + qy * ny + qz * nz
    arm = mu_r * reff
    bend = (-ROLLING_STIFFNESS * dt) * kn * arm * arm
    qx = qx + (bend * (wx - wn * nx) - out * nx)
    qy = qy + (bend * (wy - wn * ny) - out * ny)
    qz = qz + (bend * (wz - wn * nz) - out * nz)
    qx, qy, qz, _, _ = shortened(qx, qy, qz, arm * fn)
    return qx, qy, qz


@inlined
def lengths(width):  # type: ignore[no-untyped-def]
    """Return signs, lengths and inverse lengths of a laterally periodic box: what takes a pair apart."""
    signs, box = quad(1.0, 1.0, 1.0, -1.0), quad(width, width, 0.0, 0.0)
    return repeat(signs), repeat(box), repeat(quad(1.0 / width, 1.0 / width, 0.0, 0.0))


@inlined
def eight_pairs(g, place, motion, law, pairs, rolling, dt, signs, box, per_box):  # type: ignore[no-untyped-def]
    """Return whether any pair of group ``g`` touches, and the force on i, the torques on i and on j.

    Arrays are flat: ``place`` x, y, z, radius; ``motion`` velocity, 0, angular velocity, 0. ``law``:
    a row of four for each kind of pair. ``pairs``: a ``neighbors.PairList``, its springs carried along.
    ``rolling``: None where nothing resists rolling, else anything. Pairs that do not touch get zeros,
    and lose their springs.
    """
    k = PAIRS * g
    owner, neighbor = pairs.owner, pairs.neighbor
    here, there = rows(place, owner, k, 4, 0), rows(place, neighbor, k, 4, 0)
    between = here - there * signs  # the fourth numbers, the radii, are added
    dx, dy, dz, reach = across(between - nearest(between * per_box) * box)
    none = spread_lane(0.0)
    square, limit = dx * dx + dy * dy + dz * dz, reach * reach
    near = any_below(square, limit)
    if not near and not pairs.touched[g]:
        nothing = along(none, none, none, none)
        return False, nothing, nothing, nothing
    pairs.touched[g] = near
    distance = root(square)
    inverse = 1.0 / distance
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    kn, gn, mu, mu_r = across(rows(law, pairs.kind, k, 4, 0))
    vx, vy, vz, _ = across(rows(motion, owner, k, 8, 0) - rows(motion, neighbor, k, 8, 0))
    spin, spin_there = rows(motion, owner, k, 8, 4), rows(motion, neighbor, k, 8, 4)
    radius, radius_there = fourth(here), fourth(there)
    wx, wy, wz, _ = across(radius * spin + radius_there * spin_there)
    s = 3 * k
    fn, fx, fy, fz, sx, sy, sz = contact_force(
        reach - distance, nx, ny, nz,
        vx - (wy * nz - wz * ny), vy - (wz * nx - wx * nz), vz - (wx * ny - wy * nx),
        load_lane(pairs.spring, s), load_lane(pairs.spring, s + PAIRS), load_lane(pairs.spring, s + 2 * PAIRS),
        kn, gn, mu, dt,
    )  # fmt: skip
    store(pairs.spring, s, choose(square, limit, sx, none))
    store(pairs.spring, s + PAIRS, choose(square, limit, sy, none))
    store(pairs.spring, s + 2 * PAIRS, choose(square, limit, sz, none))
    moment = along(
        choose(square, limit, fy * nz - fz * ny, none),
        choose(square, limit, fz * nx - fx * nz, none),
        choose(square, limit, fx * ny - fy * nx, none),
        none,
    )
    force = along(
        choose(square, limit, fx + fn * nx, none),
        choose(square, limit, fy + fn * ny, none),
        choose(square, limit, fz + fn * nz, none),
        none,
    )
    if rolling is None:
        return True, force, rounded(radius * moment), rounded(radius_there * moment)
    ux, uy, uz, _ = across(spin - spin_there)
    product, _, _, _ = across(radius * radius_there)
    q = s + 3 * PAIRS * pairs.touched.size
    qx, qy, qz = rolling_moment(
        fn, nx, ny, nz, ux, uy, uz,
        load_lane(pairs.spring, q), load_lane(pairs.spring, q + PAIRS), load_lane(pairs.spring, q + 2 * PAIRS),
        kn, mu_r, product / reach, dt,
    )  # fmt: skip
    qx, qy, qz = choose(square, limit, qx, none), choose(square, limit, qy, none), choose(square, limit, qz, none)
    store(pairs.spring, q, qx)
    store(pairs.spring, q + PAIRS, qy)
    store(pairs.spring, q + 2 * PAIRS, qz)
    resisting = along(qx, qy, qz, none)
    return True, force, rounded(radius * moment + resisting), rounded(radius_there * moment - resisting)


@kernel
def add_pair_loads(first, last, place, motion, law, width, pairs, rolling, dt, load):  # type: ignore[no-untyped-def]
    """Add the forces and torques of the groups from ``first`` up to ``last`` to ``load``.

    ``load``: flat, force, 0, torque, 0 of each sphere. ``place``, ``motion``, ``law``, ``pairs``, ``rolling`` as in
    ``eight_pairs``. ``width``: of the periodic box.
    """
    signs, box, per_box = lengths(width)
    for g in range(first, last):
        near, force, torque, torque_there = eight_pairs(g, place, motion, law, pairs, rolling, dt, signs, box, per_box)
        if near:
            k = PAIRS * g
            add_rows(load, pairs.owner, k, 8, 0, force)
            add_rows(load, pairs.owner, k, 8, 4, torque)
            add_rows(load, pairs.neighbor, k, 8, 0, -1.0 * force)
            add_rows(load, pairs.neighbor, k, 8, 4, torque_there)
