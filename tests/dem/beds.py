"""Small beds whose bytes stand for the engine's version. ``python tests/dem/beds.py`` writes them anew."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from pdlab import dem
from pdlab.dem import deposition, saturation, simulation
from pdlab.dem.bed import Setup, State
from pdlab.dem.jit import fingerprint

RECORD = Path(__file__).with_name("beds.json")
STEPS = 4000


def setups() -> list[Setup]:
    """Equal spheres, a binary mixture, and one of three sizes and densities without local damping."""
    one = np.array([1.0])
    return [
        Setup(one, one, np.array([0.3]), np.array([120]), 4.0, 1, 0.3),
        Setup(np.array([1.0, 0.4]), np.ones(2), np.array([0.1, 0.5]), np.array([40, 400]), 4.0, 2, 0.1),
        Setup(
            np.array([1.0, 0.7, 0.5]), np.array([1.0, 1.5, 0.7]), np.array([0.2, 0.3, 0.9]), np.array([30, 60, 120]),
            4.0, 3, 0.5, local_damping=0.0, restitution=0.8,
        ),
    ]  # fmt: skip


def placed() -> list[np.ndarray]:
    """Places of a binary mixture's spheres by geometry alone: fallen and rolled, and put at random."""
    setup = setups()[1]
    return [place_them(setup)[0] for place_them in (deposition.drop_and_roll, saturation.random_placement)]


def sha(state: State) -> str:
    """Hash of the places, to the bit."""
    return hashlib.sha256(state.place.tobytes()).hexdigest()


def coarse(state: State) -> list[float]:
    """Mean place and mean square place: equal on every processor to the digits kept."""
    place = state.place[:, :3]
    return [float(f"{value:.6e}") for value in (*place.mean(0), *(place**2).mean(0))]


def record() -> dict[str, Any]:
    """What the engine of this version does on this machine."""
    beds = [simulation.advance(setup, None, STEPS) for setup in setups()]
    early = [simulation.advance(setup, None, 600) for setup in setups()]
    return {
        "version": dem.VERSION,
        "fingerprint": fingerprint(),
        "exact": [sha(bed) for bed in beds],
        "coarse": [coarse(bed) for bed in early],
        "placed": [hashlib.sha256(place.tobytes()).hexdigest() for place in placed()],
    }


if __name__ == "__main__":
    RECORD.write_text(json.dumps(record(), indent=1) + "\n", encoding="utf-8")
