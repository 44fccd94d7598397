"""How fast the analytical models are: 10 000 mixtures of four aggregates, each of six sieve classes.

``python tests/benchmarks/theory_speed.py``: seconds by the clock of each theory and of all, the least of three calls.
"""

import time

import numpy as np

from pdlab.theory import THEORIES, Material

MIXTURES, AGGREGATES, CLASSES, CALLS = 10_000, 4, 6, 3
LIMIT = 2.0
"""Seconds that all theories may take together."""


def main() -> None:
    """Print the table."""
    draw = np.random.default_rng(1)
    materials = []
    for coarsest in (0.5, 4.0, 16.0, 63.0):
        sizes = coarsest * 0.5 ** np.arange(CLASSES)
        shares = draw.dirichlet(np.ones(CLASSES))
        diameter = float(np.exp(shares @ np.log(sizes)))
        materials.append(Material(diameter, float(draw.uniform(0.55, 0.65)), tuple(sizes), tuple(shares)))
    shares = draw.dirichlet(np.ones(AGGREGATES), MIXTURES)
    total = 0.0
    for name, model in THEORIES.items():
        seconds = []
        for _ in range(CALLS):
            begun = time.perf_counter()
            out = model(materials, shares, "rodded")
            seconds.append(time.perf_counter() - begun)
        total += min(seconds)
        print(f"{name:7} {min(seconds):7.3f} s   PD {out.min():.3f} to {out.max():.3f}")
    print(f"{'all':7} {total:7.3f} s   at most {LIMIT:g} s: {'kept' if total < LIMIT else 'NOT KEPT'}")


if __name__ == "__main__":
    main()
