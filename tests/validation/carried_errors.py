"""A check by simulation of how errors are carried from an aggregate's PD to a mixture's.

``python tests/validation/carried_errors.py`` simulates the mixture of the pebble fractions L and F with
each fraction's friction moved, and prints the change of the mixture's PD beside the one that
``mixture.sensitivities`` gives. Some eight minutes on two cores; runs are kept in ``carried_errors.db``.
"""

import math

import numpy as np

from pdlab.batch.runner import Runner
from pdlab.mixture import Part, sensitivities
from pdlab.specimen import Component, Packing, equal_spheres, mixed_spheres
from pdlab.store import open_store

SEEDS = range(1, 9)
DIAMETERS = (49.77, 14.37)
BASE = (0.1, 0.2)
MOVED = {"coarse": (0.2, 0.2), "fine": (0.1, 0.1)}


def mean(runner: Runner, friction: tuple[float, float] | float) -> tuple[float, float]:
    """Return mean and standard error of a bed of one friction, or of the mixture of two."""
    if isinstance(friction, float):
        beds = [equal_spheres(friction, seed) for seed in SEEDS]
    else:
        parts = [Component(d, mu, 0.5) for d, mu in zip(DIAMETERS, friction, strict=True)]
        beds = [mixed_spheres(parts, seed) for seed in SEEDS]
    values = np.array([out.packing_density for out in runner(beds) if isinstance(out, Packing)])
    return float(values.mean()), float(values.std(ddof=1)) / math.sqrt(values.size)


def main() -> None:
    """Print the table."""
    runner = Runner(open_store("carried_errors.db"))
    alone = {mu: mean(runner, mu) for mu in (0.1, 0.2)}
    base, base_error = mean(runner, BASE)
    parts = [Part("", 0.5, ((d, 1.0),), mu, alone[mu][0], 0.0, 0.0) for d, mu in zip(DIAMETERS, BASE, strict=True)]
    weights = sensitivities(parts, base)
    print("| moved | change of its PD | change of the mixture's PD | standard error | carried |")
    print("|---|---|---|---|---|")
    for k, (name, friction) in enumerate(MOVED.items()):
        value, error = mean(runner, friction)
        change = alone[friction[k]][0] - alone[BASE[k]][0]
        print(
            f"| {name} | {change:+.4f} | {value - base:+.4f} | {math.hypot(error, base_error):.4f} | "
            f"{weights[k] * change:+.4f} |"
        )


if __name__ == "__main__":
    main()
