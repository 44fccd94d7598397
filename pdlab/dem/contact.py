"""Force and torque of one contact: linear spring and dashpot, Coulomb slip.

The law is that of Cundall and Strack (1979). The normal force is cut at zero, so the restitution
follows Schwager and Pöschel (2007).
"""

import math

import numpy as np
from scipy.optimize import brentq

from pdlab.dem.jit import kernel

KN, GN, KT, GT, MU = range(5)
"""Columns of a law table: normal stiffness and damping, tangential ones, friction coefficient."""

TANGENTIAL_STIFFNESS = 2.0 / 7.0
TANGENTIAL_DAMPING = 0.5


def restitution(zeta: float) -> float:
    """Return the restitution of a binary bounce at damping ratio ``zeta`` [-].

    Source: Schwager and Pöschel (2007): the contact ends when the force, not the overlap, is zero.
    """
    root = math.sqrt(1.0 - zeta * zeta)
    return math.exp(-zeta / root * (math.pi - 2.0 * math.asin(zeta)))


def damping_ratio(wanted: float) -> float:
    """Return the damping ratio [-] whose bounce has the restitution ``wanted``, in (0, 1]."""
    if wanted == 1.0:
        return 0.0
    return float(brentq(lambda zeta: restitution(zeta) - wanted, 0.0, 0.999, xtol=1e-14))


def law_tables(
    diameter: np.ndarray,
    mass: np.ndarray,
    friction: np.ndarray,
    wall_friction: float,
    modulus: float,
    zeta: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the contact parameters of every pair of species and of every species at a wall.

    ``diameter``, ``mass``, ``friction``: shape (S,), reduced units. ``modulus``: the contact
    modulus E, force per area. The tables have shapes (S, S, 5) and (S, 5), columns ``KN`` to ``MU``.
    Springs k_i = 2 E d_i act in series between spheres; a wall is rigid. Between two aggregates the
    smaller friction acts.
    """
    spring = 2.0 * modulus * diameter
    kn = spring[:, None] * spring[None, :] / (spring[:, None] + spring[None, :])
    meff = mass[:, None] * mass[None, :] / (mass[:, None] + mass[None, :])
    mu = np.minimum(friction[:, None], friction[None, :])
    return _law(kn, meff, mu, zeta), _law(spring, mass, np.minimum(friction, wall_friction), zeta)


def _law(kn: np.ndarray, meff: np.ndarray, mu: np.ndarray, zeta: float) -> np.ndarray:
    gn = 2.0 * zeta * np.sqrt(kn * meff)
    return np.stack([kn, gn, TANGENTIAL_STIFFNESS * kn, TANGENTIAL_DAMPING * gn, mu], axis=-1)


def collision_time(kn: np.ndarray, meff: np.ndarray, zeta: float) -> np.ndarray:
    """Return the half period π/(ω√(1−ζ²)) of the damped contact spring, shape of ``kn``, in time."""
    return np.asarray(math.pi / (np.sqrt(kn / meff) * math.sqrt(1.0 - zeta * zeta)))


@kernel
def contact_force(delta, nx, ny, nz, vx, vy, vz, sx, sy, sz, kn, gn, kt, gt, mu, dt):  # type: ignore[no-untyped-def]
    """Return normal force, tangential force (3) and tangential spring (3) of one contact.

    ``n`` points from j to i, ``v`` is the velocity of i's surface against j's at the contact, ``s``
    the spring carried along from the step before.
    """
    vn = vx * nx + vy * ny + vz * nz
    fn = max(kn * delta - gn * vn, 0.0)
    tx, ty, tz = vx - vn * nx, vy - vn * ny, vz - vn * nz
    out = sx * nx + sy * ny + sz * nz
    sx += tx * dt - out * nx
    sy += ty * dt - out * ny
    sz += tz * dt - out * nz
    fx, fy, fz = -kt * sx - gt * tx, -kt * sy - gt * ty, -kt * sz - gt * tz
    limit = mu * fn
    square = fx * fx + fy * fy + fz * fz
    if square > limit * limit:
        scale = limit / math.sqrt(square)
        fx, fy, fz = scale * fx, scale * fy, scale * fz
        if kt > 0.0:
            sx, sy, sz = -(fx + gt * tx) / kt, -(fy + gt * ty) / kt, -(fz + gt * tz) / kt
    return fn, fx, fy, fz, sx, sy, sz


@kernel
def add_pair_loads(place, motion, species, law, width, first, neighbor, touching, spring, dt, load):  # type: ignore[no-untyped-def]
    """Add the forces and torques of all pairs to ``load``; return the contacts and their Σ F_n.

    ``place`` (N, 4): x, y, z, radius. ``motion`` (N, 8): velocity, 0, angular velocity, 0. ``load``
    (N, 8): force, 0, torque, 0. The list is ``neighbor[first[i]:first[i + 1]]`` with ``touching``
    and ``spring`` (P, 3) beside it. ``width`` is that of the laterally periodic box.
    """
    contacts, total, half = 0, 0.0, 0.5 * width
    for i in range(place.shape[0]):
        xi, yi, zi, ri = place[i, 0], place[i, 1], place[i, 2], place[i, 3]
        vxi, vyi, vzi = motion[i, 0], motion[i, 1], motion[i, 2]
        wxi, wyi, wzi = ri * motion[i, 4], ri * motion[i, 5], ri * motion[i, 6]
        a = species[i]
        fxi, fyi, fzi, mxi, myi, mzi = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(first[i], first[i + 1]):
            j = neighbor[k]
            dx, dy, dz = xi - place[j, 0], yi - place[j, 1], zi - place[j, 2]
            dx += (width if dx < -half else 0.0) - (width if dx > half else 0.0)
            dy += (width if dy < -half else 0.0) - (width if dy > half else 0.0)
            rj = place[j, 3]
            reach, square = ri + rj, dx * dx + dy * dy + dz * dz
            if square >= reach * reach:
                if touching[k]:
                    touching[k] = 0
                    spring[k, 0] = spring[k, 1] = spring[k, 2] = 0.0
                continue
            touching[k] = 1
            distance = math.sqrt(square)
            inverse = 1.0 / distance
            nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
            wx = wxi + rj * motion[j, 4]
            wy = wyi + rj * motion[j, 5]
            wz = wzi + rj * motion[j, 6]
            b = species[j]
            fn, fx, fy, fz, sx, sy, sz = contact_force(
                reach - distance, nx, ny, nz,
                vxi - motion[j, 0] - (wy * nz - wz * ny),
                vyi - motion[j, 1] - (wz * nx - wx * nz),
                vzi - motion[j, 2] - (wx * ny - wy * nx),
                spring[k, 0], spring[k, 1], spring[k, 2],
                law[a, b, 0], law[a, b, 1], law[a, b, 2], law[a, b, 3], law[a, b, 4], dt,
            )  # fmt: skip
            spring[k, 0], spring[k, 1], spring[k, 2] = sx, sy, sz
            mx, my, mz = fy * nz - fz * ny, fz * nx - fx * nz, fx * ny - fy * nx
            fx, fy, fz = fx + fn * nx, fy + fn * ny, fz + fn * nz
            fxi, fyi, fzi = fxi + fx, fyi + fy, fzi + fz
            mxi, myi, mzi = mxi + mx, myi + my, mzi + mz
            load[j, 0] -= fx
            load[j, 1] -= fy
            load[j, 2] -= fz
            load[j, 4] += rj * mx
            load[j, 5] += rj * my
            load[j, 6] += rj * mz
            contacts, total = contacts + 1, total + fn
        load[i, 0] += fxi
        load[i, 1] += fyi
        load[i, 2] += fzi
        load[i, 4] += ri * mxi
        load[i, 5] += ri * myi
        load[i, 6] += ri * mzi
    return contacts, total
