"""How fast the analytical models are: 10 000 mixtures of four aggregates, each of six sieve classes.

``python tests/benchmarks/theory_speed.py``: seconds by the clock, the least of three calls, of each theory with arrays;
then of all three from rows as a store gives them, read already, of mixtures that draw their four aggregates from 4, 200
or 1000, gradings and density tests included.
"""

import time
from collections.abc import Callable

import numpy as np

from pdlab.experiments.theories import evaluate, recipes
from pdlab.models import Aggregate, Mixture, MixtureComponent, PackingTest, SieveAnalysis, SieveResult
from pdlab.theory import THEORIES, Material

MIXTURES, AGGREGATES, CLASSES, CALLS = 10_000, 4, 6, 3
LIMIT = 2.0
"""Seconds that all theories may take together."""


def stored(aggregates: int) -> tuple[list[Mixture], list[Aggregate]]:
    """Return rows of mixtures that draw their aggregates from so many."""
    draw = np.random.default_rng(1)
    rows = []
    for k in range(1, aggregates + 1):
        coarsest = float(draw.choice([2.0, 4.0, 8.0, 16.0, 31.5, 63.0]))
        held = 100.0 * draw.dirichlet(np.ones(CLASSES))
        sieves = [SieveResult(position=0, aperture_mm=coarsest, retained_percent=0.0)]
        sieves += [
            SieveResult(position=j, aperture_mm=coarsest * 0.5**j, retained_percent=float(value))
            for j, value in enumerate(held, 1)
        ]
        analysis = SieveAnalysis(id=k, kind="retained_percent", results=sieves)
        test = PackingTest(id=k, compaction="loose", packing_density=float(draw.uniform(0.5, 0.6)))
        rows.append(Aggregate(id=k, name=f"A{k}", sieve_analyses=[analysis], packing_tests=[test]))
    mixtures = []
    for k in range(MIXTURES):
        parts = zip(
            draw.choice(aggregates, AGGREGATES, replace=False), draw.dirichlet(np.ones(AGGREGATES)), strict=True
        )
        components = [MixtureComponent(aggregate_id=int(j) + 1, solid_volume_share=float(share)) for j, share in parts]
        mixtures.append(Mixture(name=f"M{k}", components=components, packing_tests=[]))
    return mixtures, rows


def least(work: Callable[[], object]) -> float:
    """Return the seconds by the clock of the fastest of some calls."""
    seconds = []
    for _ in range(CALLS):
        begun = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begun)
    return min(seconds)


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
        seconds = least(lambda model=model: model(materials, shares, "rodded"))
        out = model(materials, shares, "rodded")
        total += seconds
        print(f"{name:7} {seconds:7.3f} s   PD {out.min():.3f} to {out.max():.3f}")
    print(f"{'all':7} {total:7.3f} s   at most {LIMIT:g} s: {'kept' if total < LIMIT else 'NOT KEPT'}")
    for count in (AGGREGATES, 200, 1000):
        mixtures, rows = stored(count)
        seconds = least(lambda mixtures=mixtures, rows=rows: evaluate(recipes(mixtures, rows)))
        print(f"all, from rows of {count:4} aggregates {seconds:7.3f} s")


if __name__ == "__main__":
    main()
