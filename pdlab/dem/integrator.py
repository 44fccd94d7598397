"""Motion of the spheres: leapfrog, with the local damping of PFC3D; the time step."""

import numpy as np
from numba import prange

from pdlab.dem.contact import collision_time
from pdlab.dem.jit import inlined, kernel, threaded
from pdlab.dem.simd import choose, load, quad, size, spread, store, total
from pdlab.dem.walls import wall_load


def time_step(law: np.ndarray, mass: np.ndarray, zeta: float, steps_per_collision: float) -> float:
    """Return the shortest collision time of any two species divided by ``steps_per_collision``.

    ``law`` (S, S, 4) as from ``contact.law_tables``, ``mass`` (S,), reduced units. At a wall the
    same sphere collides as slowly as with its like.
    """
    meff = mass[:, None] * mass[None, :] / (mass[:, None] + mass[None, :])
    return float(collision_time(law[..., 0], meff, zeta).min()) / steps_per_collision


@kernel
def start_loads(place, motion, species, law, near, width, radius, dt, loads):  # type: ignore[no-untyped-def]
    """Set ``loads`` to what the walls do: mostly nothing. Arrays flat, as in ``walls.wall_load``."""
    for i in range(species.size):
        store(loads, 8 * i, spread(0.0))
        store(loads, 8 * i + 4, spread(0.0))
        if near.first[i] < near.first[i + 1]:
            fx, fy, fz, tx, ty, tz = wall_load(i, place, motion, law[species[i]], near, width, radius, dt)
            store(loads, 8 * i, quad(fx, fy, fz, 0.0))
            store(loads, 8 * i + 4, quad(tx, ty, tz, 0.0))


@inlined
def opposed(alpha, resultant, speed):  # type: ignore[no-untyped-def]
    """Return a resultant, each component reduced by ``alpha`` times its size against the speed's sign."""
    zero = spread(0.0)
    drag = alpha * size(resultant)
    return resultant - choose(zero, speed, drag, choose(speed, zero, -1.0 * drag, zero))


@inlined
def move_one(i, force, torque, place, motion, species, body, gravity, alpha, beta, dt, origin):  # type: ignore[no-untyped-def]
    """Advance one sphere; return whether it went farther than its allowance, or is no number."""
    b = species[i]
    speed, spin = load(motion, 8 * i), load(motion, 8 * i + 4)
    speed = speed + (dt / body[b, 0]) * opposed(alpha, force + body[b, 0] * gravity, speed)
    store(motion, 8 * i, speed)
    store(motion, 8 * i + 4, spin + (dt * body[b, 1]) * opposed(beta, torque, spin))
    now = load(place, 4 * i) + dt * speed
    store(place, 4 * i, now)
    gone = now - load(origin, 4 * i)
    return not (total(gone * gone * quad(1.0, 1.0, 1.0, -1.0)) <= 0.0)


@kernel
def move(place, motion, species, body, loads, gx, gy, gz, alpha, beta, dt, origin):  # type: ignore[no-untyped-def]
    """Advance velocities by ``loads`` and places by the velocities; return whether the list is stale.

    Arrays flat but ``body`` (S, 2): mass and inverse moment of inertia. Each component of the
    resultant, gravity ``g`` included, is reduced by ``alpha`` times its size against the velocity, of the
    moment by ``beta``.
    ``origin``: where each sphere was when the list was made, and its radius less its allowance; the
    list is stale when one went farther, and written so that a NaN, too, ends its life.
    """
    stale, gravity = False, quad(gx, gy, gz, 0.0)
    for i in range(species.size):
        force, torque = load(loads, 8 * i), load(loads, 8 * i + 4)
        stale |= move_one(i, force, torque, place, motion, species, body, gravity, alpha, beta, dt, origin)
    return stale


@threaded
def gather_and_move(  # type: ignore[no-untyped-def]
    place, motion, species, body, law, near, width, radius, first, entry, pair_loads,
    gx, gy, gz, alpha, beta, dt, origin, parts, loads, stale,
):  # fmt: skip
    """Do what ``start_loads``, ``contact.add_pair_loads`` and ``move`` do, on several threads.

    ``first``, ``entry``: as from ``neighbors.incidence``; ``pair_loads`` as from
    ``contact.store_pair_loads``. Each sphere adds up its own loads, in the order of the other way, so
    that all bytes are equal. ``stale`` (parts,) is what ``move`` returns, part by part.
    """
    n = species.size
    for part in prange(parts):
        gravity, late = quad(gx, gy, gz, 0.0), False
        for i in range(part * n // parts, (part + 1) * n // parts):
            force, torque = spread(0.0), spread(0.0)
            if near.first[i] < near.first[i + 1]:
                fx, fy, fz, tx, ty, tz = wall_load(i, place, motion, law[species[i]], near, width, radius, dt)
                force, torque = quad(fx, fy, fz, 0.0), quad(tx, ty, tz, 0.0)
            for e in range(first[i], first[i + 1]):
                side, k = entry[e] & 1, entry[e] >> 1
                row = 96 * (k >> 3) + 4 * (k & 7)
                there = load(pair_loads, row)
                force = force + (-1.0 * there if side else there)
                torque = torque + load(pair_loads, row + 32 + 32 * side)
            store(loads, 8 * i, force)
            store(loads, 8 * i + 4, torque)
            late |= move_one(i, force, torque, place, motion, species, body, gravity, alpha, beta, dt, origin)
        stale[part] = late


@kernel
def kinetic_energy(motion, species, body):  # type: ignore[no-untyped-def]
    """Return the kinetic energy of all spheres, rotation included; held rotation counts nothing."""
    energy = 0.0
    for i in range(motion.shape[0]):
        mass, spin = body[species[i], 0], body[species[i], 1]
        energy += 0.5 * mass * (motion[i, 0] ** 2 + motion[i, 1] ** 2 + motion[i, 2] ** 2)
        if spin > 0.0:
            energy += 0.5 / spin * (motion[i, 4] ** 2 + motion[i, 5] ** 2 + motion[i, 6] ** 2)
    return energy


def mean_resultant(load: np.ndarray, species: np.ndarray, body: np.ndarray, gravity: np.ndarray) -> float:
    """Return the mean size of the resultant force, before damping, on spheres with contacts.

    ``load`` (N, 8) of the last step, ``species`` (N,), ``body`` (S, 2), ``gravity`` (3,).
    """
    held = np.any(load[:, :3] != 0.0, axis=1)
    if not held.any():
        return np.inf
    resultant = load[held, :3] + body[species[held], 0][:, None] * gravity
    return float(np.sqrt((resultant**2).sum(axis=1)).mean())
