"""Real beds: what a sweep finds of the densest mix, beside a dense reference of many beds.

``python tests/validation/densest.py STORE`` sweeps two aggregates of a size ratio of 3.5 and three of 1, 0.5 and 0.3,
and compares the densest mix found with reference beds of other seeds; it prints the tables of ``docs/sweep.md``. Runs
are kept in the store, so that a run broken off carries on where it was. Some three hours on one core.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from pdlab.batch.pools import ProcessPool
from pdlab.batch.runner import Runner
from pdlab.mixture import Part, next_specimens, scatter
from pdlab.plan import finish
from pdlab.specimen import Packing, Specimen, on_grid
from pdlab.store import open_store
from pdlab.sweep import Swept, sweeping

Shares = tuple[float, ...]
L, M, F = (0.1258, 0.6000, 0.0005), (0.07222, 0.6120, 0.0005), (0.2232, 0.5830, 0.0006)
"""Friction, PD and curve error of Feret's pebbles L, M and F, as ``pdlab demo`` calibrates them."""
FRESH = range(201, 205)
"""Seeds of the beds by which the found mix and the reference's best are compared."""


def part(diameter: float, facts: tuple[float, float, float]) -> Part:
    """Return an aggregate of this diameter [mm]."""
    return Part(f"{diameter:g} mm", 1.0, ((diameter, 1.0),), facts[0], facts[1], 0.005, facts[2])


@dataclass(frozen=True)
class Case:
    """Aggregates, the mixes of the reference with their seeds, and the seeds by which sweeps are repeated."""

    name: str
    parts: list[Part]
    mixes: list[Shares]
    seeds: range


def triangle(steps: int) -> Iterator[Shares]:
    """Return the mixes of three aggregates on a coarse grid that are rich enough in the coarsest to be dense."""
    for coarse, middle in itertools.product(range(5, 8), range(steps)):
        if coarse + middle <= steps:
            yield tuple(round(k / steps, 4) for k in (coarse, middle, steps - coarse - middle))


COARSE = (
    0.4, 0.45, 0.5, 0.55, 0.6, 0.625, 0.65, 0.675, 0.7, 0.725, 0.75, 0.775, 0.8, 0.825, 0.85, 0.9, 0.95,
)  # fmt: skip
CASES = {
    "binary": Case(
        "two aggregates, size ratio 3.5", [part(3.5, L), part(1.0, F)], [(x, round(1.0 - x, 4)) for x in COARSE],
        range(101, 105),
    ),
    "ternary": Case(
        "three aggregates, 1 : 0.5 : 0.3", [part(1.0, L), part(0.5, M), part(0.3, F)], list(triangle(10)),
        range(101, 103),
    ),
}  # fmt: skip


def bed(parts: Sequence[Part], shares: Shares, seed: int) -> Specimen:
    """Return the bed of a mix."""
    present = [replace(one, share=share) for one, share in zip(parts, shares, strict=True) if share > 0.0]
    return replace(next_specimens(present, [], seeds=1)[0], seed=seed)


def mean(runner: Runner, parts: Sequence[Part], shares: Shares, seeds: range) -> tuple[float, float, float]:
    """Return the mean PD of a mix over seeds, its standard error, and the deviation of one seed over the expected."""
    beds = [bed(parts, shares, seed) for seed in seeds]
    values = np.array([out.packing_density for out in runner(beds) if isinstance(out, Packing)])
    present = [replace(one, share=share) for one, share in zip(parts, shares, strict=True) if share > 0.0]
    one = float(values.std(ddof=1))
    return float(values.mean()), one / math.sqrt(values.size), one / scatter(present, beds[0], float(values.mean()))


def said(shares: Shares) -> str:
    return " / ".join(f"{share:g}" for share in shares)


def sweeps(runner: Runner, case: Case, seeds: range) -> list[Swept]:
    """Sweep, once for each seed, and print what each found."""
    print("| seed of the sweep | beds | densest mix | PD ± simulation | fresh seeds |", flush=True)
    print("|---|---|---|---|---|")
    out = list[Swept]()
    for seed in seeds:
        found = finish(sweeping(case.parts, seed=seed), runner)
        best = found.densest
        fresh, error, _ = mean(runner, case.parts, best.shares, FRESH)
        low, high = said(best.low), said(best.high)
        print(
            f"| {seed} | {len(found.points)} | {said(best.shares)} ({low} to {high}) | {best.packing_density:.4f} ± "
            f"{best.standard_error:.4f} | {fresh:.4f} ± {error:.4f} |",
            flush=True,
        )
        out.append(found)
    return out


def reference(runner: Runner, case: Case, found: Swept) -> tuple[Shares, ...]:
    """Run the reference and print it beside the sweep's curve; return its best mixes, the densest first."""
    print(f"\n| mix | reference, {len(case.seeds)} seeds | one seed's deviation over the expected | sweep |")
    print("|---|---|---|---|", flush=True)
    means, ratios = dict[Shares, float](), list[float]()
    for shares in case.mixes:
        means[shares], error, ratio = mean(runner, case.parts, shares, case.seeds)
        at = int(np.argmin(np.max(np.abs(found.shares - shares), axis=1)))
        ratios.append(ratio)
        print(
            f"| {said(shares)} | {means[shares]:.4f} ± {error:.4f} | {ratio:.2f} | {found.packing_density[at]:.4f} ± "
            f"{found.deviation[at]:.4f} |",
            flush=True,
        )
    print(f"\ndeviation over the expected, root mean square: {on_grid(math.sqrt(np.mean(np.square(ratios)))):.2f}")
    return tuple(sorted(means, key=lambda shares: -means[shares]))


def main(
    store: Annotated[str, typer.Argument(help="Where runs are kept.")],
    case: Annotated[str, typer.Option(help=f"One of {', '.join(CASES)}.")] = "binary",
    repeats: Annotated[int, typer.Option(min=1, help="Sweeps, each of other beds.")] = 3,
    workers: int = 1,
) -> None:
    """Sweep, run the reference, and print the tables."""
    runner, chosen = Runner(open_store(store), ProcessPool(workers)), CASES[case]
    print(f"### {chosen.name}\n")
    found = sweeps(runner, chosen, range(1, repeats + 1))
    best = reference(runner, chosen, found[0])
    print("\n| the reference's best mixes | fresh seeds |\n|---|---|")
    for shares in best[:3]:
        fresh, error, _ = mean(runner, chosen.parts, shares, FRESH)
        print(f"| {said(shares)} | {fresh:.4f} ± {error:.4f} |", flush=True)
    runner.close()


if __name__ == "__main__":
    typer.run(main)
