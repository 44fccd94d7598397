"""How fast beds go: million sphere-steps a second in the fall, while settling and at rest, on one thread.

``python tests/benchmarks/bed_speed.py``: equal spheres (μ = 0.3), then a pebble mixture of size ratio 3.5.
Compare figures of one run only: they move by some 20 % between hours.
"""

import time

from pdlab import packing
from pdlab.specimen import Component, Specimen, equal_spheres, mixed_spheres

CHUNK = 2000


def watch(name: str, specimen: Specimen) -> None:
    """Print the speed of every fifth of a bed's way to rest, and the whole."""
    packing.advance(specimen, None, 1)  # compiled, or read from the cache
    state, rates, seconds = None, list[float](), 0.0
    while state is None or not state.rest:
        begun, before = time.perf_counter(), 0 if state is None else state.steps
        state = packing.advance(specimen, state, CHUNK)
        spent = time.perf_counter() - begun
        seconds += spent
        rates.append((state.steps - before) * specimen.spheres / spent / 1e6)
    shown = " ".join(f"{rate:.1f}" for rate in rates[:: max(1, len(rates) // 5)])
    print(f"{name}: {specimen.spheres} spheres, {state.steps} steps, {seconds:.1f} s; million sphere-steps/s {shown}")


if __name__ == "__main__":
    watch("equal spheres", equal_spheres(0.3, 1))
    watch("size ratio 3.5", mixed_spheres([Component(49.77, 0.1308, 0.5), Component(14.37, 0.2229, 0.5)], 1))
