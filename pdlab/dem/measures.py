"""What a bed shows: its packing density, contacts, overlaps."""

import math

import numpy as np

from pdlab.dem.bed import Setup, State
from pdlab.dem.contact import KN

MAX_OVERLAP = 0.02


def slab(place: np.ndarray) -> tuple[float, float]:
    """Return the middle half of a bed, from a quarter to three quarters of its height.

    ``place`` (N, 4). The height is twice that of the solids' centre of mass.
    """
    solid = place[:, 3] ** 3
    height = 2.0 * float((solid * place[:, 2]).sum() / solid.sum())
    return 0.25 * height, 0.75 * height


def solids_between(place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return each sphere's volume between two planes, shape (N,), cut spheres by exact segments."""
    r, z = place[:, 3], place[:, 2]
    below = np.clip(high - z, -r, r), np.clip(low - z, -r, r)
    upper, lower = (math.pi / 3.0 * (r + t) ** 2 * (2.0 * r - t) for t in below)
    return np.asarray(upper - lower)


def solid_fraction(place: np.ndarray, area: float, low: float, high: float) -> float:
    """Return the solid fraction between two planes of a bed on a floor of ``area``."""
    return float(solids_between(place, low, high).sum()) / (area * (high - low))


def contacts(setup: Setup, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the spheres i and j of every contact and its overlap, each of shape (K,)."""
    real = state.pairs.kind < setup.diameter.size**2
    i, j = (index[real].astype(np.int64) for index in (state.pairs.owner, state.pairs.neighbor))
    apart = state.place[i, :3] - state.place[j, :3]
    apart[:, :2] -= setup.box * np.round(apart[:, :2] / setup.box)
    delta = state.place[i, 3] + state.place[j, 3] - np.sqrt((apart**2).sum(axis=1))
    touch = delta > 0.0
    return i[touch], j[touch], delta[touch]


def mean_force(setup: Setup, state: State) -> float:
    """Return the mean normal force of the springs at all contacts, the floor's included."""
    i, j, delta = contacts(setup, state)
    kn, wall_kn = setup.laws[0][..., KN], setup.laws[1][:, KN]
    pressed = np.maximum(state.place[:, 3] - state.place[:, 2], 0.0)
    forces = [kn[state.species[i], state.species[j]] * delta, (wall_kn[state.species] * pressed)[pressed > 0.0]]
    every = np.concatenate(forces)
    return float(every.mean()) if every.size else 0.0


def contacts_per_sphere(place: np.ndarray, i: np.ndarray, j: np.ndarray, low: float, high: float) -> float:
    """Return the mean contacts, walls excluded, of the spheres centred between two planes.

    ``place`` (N, 4); ``i``, ``j`` (K,): the spheres of each contact.
    """
    count = np.bincount(i, minlength=len(place)) + np.bincount(j, minlength=len(place))
    inside = (place[:, 2] >= low) & (place[:, 2] <= high)
    return float(count[inside].mean())


def largest_overlap(place: np.ndarray, i: np.ndarray, j: np.ndarray, delta: np.ndarray) -> float:
    """Return the largest overlap of two spheres over the smaller one's diameter.

    ``place`` (N, 4); ``i``, ``j``, ``delta`` (K,): the spheres of each contact and its overlap.
    """
    smaller = 2.0 * np.minimum(place[i, 3], place[j, 3])
    return float((delta / smaller).max(initial=0.0))
