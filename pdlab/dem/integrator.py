"""Motion of the spheres: leapfrog, with the local damping of PFC3D; the time step."""

import numpy as np

from pdlab.dem.contact import collision_time
from pdlab.dem.jit import inlined, kernel
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
def wall_loads(first, last, place, motion, species, law, near, width, container, rim, dt, loads):  # type: ignore[no-untyped-def]
    """Set the loads of the spheres from ``first`` up to ``last`` to what the walls do: mostly nothing.

    Arrays flat, as in ``walls.wall_load``.
    """
    for i in range(first, last):
        store(loads, 8 * i, spread(0.0))
        store(loads, 8 * i + 4, spread(0.0))
        if near.first[i] < near.first[i + 1]:
            fx, fy, fz, tx, ty, tz = wall_load(i, place, motion, law[species[i]], near, width, container, rim, dt)
            store(loads, 8 * i, quad(fx, fy, fz, 0.0))
            store(loads, 8 * i + 4, quad(tx, ty, tz, 0.0))


@inlined
def opposed(alpha, resultant, speed):  # type: ignore[no-untyped-def]
    """Return a resultant, each component reduced by ``alpha`` times its size against the speed's sign."""
    zero = spread(0.0)
    drag = alpha * size(resultant)
    return resultant - choose(zero, speed, drag, choose(speed, zero, -1.0 * drag, zero))


@kernel
def move(first, last, place, motion, species, body, loads, gx, gy, gz, alpha, beta, dt, origin):  # type: ignore[no-untyped-def]
    """Advance the spheres from ``first`` up to ``last``: velocities by ``loads``, places by the velocities.

    Arrays flat but ``body`` (S, 2): mass and inverse moment of inertia. Each component of the
    resultant, gravity ``g`` included, is reduced by ``alpha`` times its size against the velocity, of the
    moment by ``beta``. ``origin``: where each sphere was when the list was made, and its radius less its
    allowance. Returned: whether one went farther than its allowance, or is no number.
    """
    stale, gravity = False, quad(gx, gy, gz, 0.0)
    for i in range(first, last):
        b = species[i]
        force, torque, speed, spin = (
            load(loads, 8 * i), load(loads, 8 * i + 4), load(motion, 8 * i), load(motion, 8 * i + 4),
        )  # fmt: skip
        speed = speed + (dt / body[b, 0]) * opposed(alpha, force + body[b, 0] * gravity, speed)
        store(motion, 8 * i, speed)
        store(motion, 8 * i + 4, spin + (dt * body[b, 1]) * opposed(beta, torque, spin))
        now = load(place, 4 * i) + dt * speed
        store(place, 4 * i, now)
        gone = now - load(origin, 4 * i)
        stale |= not (total(gone * gone * quad(1.0, 1.0, 1.0, -1.0)) <= 0.0)
    return stale


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
