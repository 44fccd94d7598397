"""What the choices behind a sweep are worth: theory, kernel and next bed against others, on formula surfaces.

``python tests/benchmarks/sweep_choices.py`` prints the table of ``docs/sweep.md``. Some ten minutes of one core.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import typer

from pdlab import surface, sweep, theory
from pdlab.plan import finish

sys.path.insert(0, str(Path(__file__).parents[1]))
from surfaces import KINDS, Engine, shape

WIDE = (0.02, 0.05, 0.1)
"""Deviations for a mean that is no theory of mixtures."""


def _most_uncertain(self: surface.Surface, chances: surface.Floats, error: object) -> surface.Floats:
    return self.deviation


def _densest_by_now(self: surface.Surface, chances: surface.Floats, error: object) -> surface.Floats:
    return self.mean


def _most_likely(self: surface.Surface, chances: surface.Floats, error: object) -> surface.Floats:
    return chances


CHOICES: dict[str, list[tuple[object, str, Any]]] = {
    "as it is": [],
    "theory: Toufar alone": [(sweep, "BENDS", (0.0,))],
    "theory: Furnas alone": [(sweep, "BENDS", (1.0,)), (surface, "DEVIATIONS", WIDE)],
    "theory: none, the volume mean": [
        (sweep, "BENDS", (0.0,)), (theory, "toufar", theory.volume_mean), (surface, "DEVIATIONS", WIDE),
    ],
    "kernel: Matérn 3/2": [(surface, "SMOOTHNESS", 1.5)],
    "kernel: squared exponential": [(surface, "SMOOTHNESS", np.inf)],
    "kernel: one deviation and length": [(surface, "DEVIATIONS", (0.01,)), (surface, "LENGTHS", (0.5,))],
    "next bed: the most uncertain": [(surface.Surface, "telling", _most_uncertain)],
    "next bed: the densest by now": [(surface.Surface, "telling", _densest_by_now)],
    "next bed: the likeliest densest": [(surface.Surface, "telling", _most_likely)],
}  # fmt: skip


@contextmanager
def chosen(changes: list[tuple[object, str, Any]]) -> Iterator[None]:
    """Make choices otherwise in the block."""
    patches = [patch.object(where, name, value) for where, name, value in changes]
    for one in patches:
        one.start()
    yield
    for one in patches:
        one.stop()


def swept(aggregates: int, number: int, kind: str, **how: Any) -> tuple[float, ...]:
    """Return a sweep's beds, how much denser the truth's best is than its mix, and its PD's error over the stated."""
    parts, truth = shape(kind, number, aggregates)
    engine = Engine(parts, truth)
    found = finish(sweep.sweeping(parts, **how), engine)
    true = float(truth(np.array([found.densest.shares]))[0])
    off = (found.densest.packing_density - true) / max(found.densest.standard_error, 1e-4)
    return len(engine.asked), float(truth(found.shares).max()) - true, off


def row(name: str, results: list[tuple[float, ...]]) -> None:
    """Print a row of the table."""
    beds, lost, off = np.array(results).T
    print(
        f"| {name} | {beds.mean():.1f} | {lost.mean():.4f} | {lost.max():.4f} | {np.mean(lost > 0.003):.2f} | "
        f"{np.sqrt(np.mean(off**2)):.2f} | {np.mean(np.abs(off) < 1):.2f} | {np.mean(np.abs(off) < 2):.2f} |",
        flush=True,
    )


def main(numbers: int = 15, beds: int = 6) -> None:
    """Print all choices at a fixed number of beds, then the sweep as it ends by itself."""
    print("| choice | beds | PD lost, mean | largest | above 0.003 | error over stated | within 1 | within 2 |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name, changes in CHOICES.items():
        with chosen(changes):
            cases = [(number, kind) for kind in KINDS for number in range(numbers)]
            row(name, [swept(2, *case, wished_error=1e-6, most_specimens=beds) for case in cases])
    for aggregates, count in ((2, numbers), (3, numbers // 3)):
        for kind in KINDS:
            results = [swept(aggregates, 100 + number, kind) for number in range(count)]
            row(f"{aggregates} aggregates, {kind}, to ± 0.001", results)


if __name__ == "__main__":
    typer.run(main)
