"""What the geometric methods give and cost: packing density of four seeds, contacts per sphere, processor time.

``python tests/benchmarks/geometric_methods.py``: equal spheres, then the pebble mixture of size ratio 3.5, then 30 %
fines at a size ratio of 10. With ``--dem`` the loose beds of the first two stand beside them (minutes).
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from pdlab import packing
from pdlab.dem import deposition, measures, profiles, saturation, simulation
from pdlab.dem.bed import Setup
from pdlab.geometry import LATTICES, nested
from pdlab.specimen import Component, Specimen, equal_spheres, mixed_spheres, with_seeds

SEEDS = (1, 2, 3, 4)
SPECIMENS = {
    "equal spheres": equal_spheres(0.3, 1),
    "size ratio 3.5": mixed_spheres([Component(49.77, 0.1308, 0.5), Component(14.37, 0.2229, 0.5)], 1),
    "size ratio 10": mixed_spheres([Component(10.0, 0.3, 0.7), Component(1.0, 0.3, 0.3)], 1),
}


def poured(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return places and species of the loose bed, by discrete elements."""
    state = simulation.advance(setup, None, 10**9)
    return state.place, state.species


def watch(name: str, specimen: Specimen, place_them: Callable[[Setup], tuple[np.ndarray, np.ndarray]]) -> None:
    """Print the packing density in the middle half, its scatter, contacts, the coarsest's share there, seconds."""
    density, contacts, share, seconds = [], [], [], []
    for one in with_seeds(specimen, SEEDS):
        setup, begun = packing.setup(one), time.process_time()
        place, species = place_them(setup)
        seconds.append(time.process_time() - begun)
        low, high = measures.slab(place)
        solids = np.bincount(species, measures.solids_between(place, low, high))
        i, j, _ = profiles.touching(place, setup.width, profiles.GAP)
        density.append(measures.solid_fraction(place, setup.area, low, high))
        contacts.append(measures.contacts_per_sphere(place, i, j, low, high))
        share.append(solids[0] / solids.sum())
    print(
        f"  {name:14} PD {np.mean(density):.4f}, standard deviation {np.std(density, ddof=1):.4f}; contacts "
        f"{np.mean(contacts):.2f}; coarsest {min(share):.3f} to {max(share):.3f}; "
        f"{np.median(seconds):.2f} s of the processor a bed"
    )


if __name__ == "__main__":
    methods = {"drop_and_roll": deposition.drop_and_roll, "static": saturation.random_placement}
    methods |= {"loose": poured} if "--dem" in sys.argv else {}
    deposition.drop_and_roll(packing.setup(SPECIMENS["equal spheres"]))  # compiled, or read from the cache
    for name, specimen in SPECIMENS.items():
        print(f"{name}: {specimen.spheres} spheres")
        for method, place_them in methods.items():
            if method != "loose" or specimen.spheres < 10_000:
                watch(method, specimen, place_them)
        print(f"  {'ordered':14} PD {nested(specimen.shares):.4f}, fcc alone {LATTICES['fcc']:.4f}")
