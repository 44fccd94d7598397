"""Motion of the spheres: leapfrog, with the local damping of PFC3D; the time step."""

import numpy as np

from pdlab.dem.contact import collision_time
from pdlab.dem.jit import kernel


def time_step(law: np.ndarray, mass: np.ndarray, zeta: float, steps_per_collision: float) -> float:
    """Return the shortest collision time of any two species divided by ``steps_per_collision``.

    ``law`` (S, S, 5) as from ``contact.law_tables``, ``mass`` (S,), reduced units. At the floor the
    same sphere collides as slowly as with its like.
    """
    meff = mass[:, None] * mass[None, :] / (mass[:, None] + mass[None, :])
    return float(collision_time(law[..., 0], meff, zeta).min()) / steps_per_collision


@kernel
def move(place, motion, species, body, load, gravity, alpha, dt, origin, allowance):  # type: ignore[no-untyped-def]
    """Advance velocities by ``load`` and places by the velocities; return whether the list is stale.

    ``body`` (S, 2): mass and inverse moment of inertia. Each component of the resultant (gravity
    included) is reduced by ``alpha`` times its size against the velocity. ``origin`` (N, 3): places
    when the list was made; it is stale when one went farther than its ``allowance``.
    """
    stale = False
    for i in range(place.shape[0]):
        mass, spin = body[species[i], 0], body[species[i], 1]
        gone = 0.0
        for axis in range(3):
            force, v = load[i, axis] + mass * gravity[axis], motion[i, axis]
            drag = alpha * abs(force)
            force -= drag if v > 0.0 else (-drag if v < 0.0 else 0.0)
            v += force / mass * dt
            motion[i, axis] = v
            motion[i, 4 + axis] += load[i, 4 + axis] * spin * dt
            place[i, axis] += v * dt
            gone += (place[i, axis] - origin[i, axis]) ** 2
        # written so that a NaN, too, ends the list's life, and with it the run
        stale |= not (gone <= allowance[i] * allowance[i])
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
