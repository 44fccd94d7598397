"""What the runner costs: two processes beside one, its own time for each run, a table of which all is known.

    python tests/benchmarks/runner_speed.py                 all three; the first wants an idle machine
    python tests/benchmarks/runner_speed.py --only cached   one of processes, own, cached

``processes``: the same beds of 2500 equal spheres by one process and by two, in turns, each in a new store, workers
started before the clock is. ``own``: beds that are at rest at once stand for the engine, so that what is left is the
runner's: reading, claiming, handing out, writing. ``cached``: mixtures of three of twenty aggregates, predicted by a
formula first; then the table is predicted again.
"""

import csv
import itertools
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer

sys.path.insert(0, str(Path(__file__).parents[1]))
from conftest import FormulaPool

from pdlab import experiments, tables
from pdlab.batch.pools import Pool, ProcessPool
from pdlab.batch.runner import Runner
from pdlab.lab import Lab
from pdlab.specimen import equal_spheres, with_seeds
from pdlab.store import open_store

PARTS = ("processes", "own", "cached")


class TwoAtOnce(FormulaPool):
    """The formula in the place of two workers."""

    workers = 2


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Return the seconds [s] by the clock and of the processor that a call takes."""
    begun, used = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - begun, time.process_time() - used


def run(folder: Path, pool: Pool, count: int, warm: bool) -> tuple[float, float]:
    """Run so many beds into a new store."""
    target = open_store(folder / f"{time.monotonic_ns()}.db")
    runner = Runner(target, pool)
    if warm:
        runner(with_seeds(equal_spheres(0.3, 1), range(1001, 1001 + pool.workers)))
    found = timed(lambda: runner(with_seeds(equal_spheres(0.3, 1), range(1, count + 1))))
    runner.close()
    target.close()
    return found


def processes(folder: Path, beds: int, rounds: int) -> None:
    """Print how much faster two processes are than one."""
    ratios = list[float]()
    for k in range(rounds):
        one, _ = run(folder, ProcessPool(1), beds, warm=True)
        two, _ = run(folder, ProcessPool(2), beds, warm=True)
        ratios.append(one / two)
        print(
            f"round {k + 1}: {beds} beds by one process {one:.1f} s, by two {two:.1f} s, {one / two:.2f} times as fast"
        )
    print(f"two processes beside one: {statistics.median(ratios):.2f} times as fast (median)")


def own(folder: Path, runs: int, rounds: int) -> None:
    """Print what the runner itself takes for each run."""
    for _ in range(rounds):
        clock, used = run(folder, TwoAtOnce(), runs, warm=False)
        ms, of_processor = 1e3 * clock / runs, 1e3 * used / runs
        print(f"the runner's own cost of a run: {ms:.2f} ms by the clock, {of_processor:.2f} ms of the processor")


def cached(folder: Path, rows: int, rounds: int) -> None:
    """Print how long a table takes of which all is known."""
    draw, names = np.random.default_rng(1), [f"aggregate {k}" for k in range(20)]
    frames = {
        "aggregates": pd.DataFrame({"name": names}),
        "sieves": pd.DataFrame(
            [
                {"aggregate": name, "aperture_mm": aperture, "passing_percent": passing}
                for k, name in enumerate(names)
                for aperture, passing in ((16.0 + k, 100.0), (8.0, 40.0), (4.0, 0.0))
            ]
        ),
        "packing_tests": pd.DataFrame(
            [
                {"material": name, "compaction": "loose", "packing_density": round(0.57 + 0.003 * k, 4)}
                for k, name in enumerate(names)
            ]
        ),
    }
    with (folder / "in.csv").open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["mixture", "aggregate", "solid_volume_share"])
        for k in range(rows):
            first, second = draw.uniform(0.1, 0.45, 2).round(3)
            shares = (first, second, round(1.0 - first - second, 3))
            chosen = draw.choice(20, 3, replace=False)
            out.writerows((f"mixture {k}", names[at], share) for at, share in zip(chosen, shares, strict=True))
    with Lab(folder / "lab.db", workers=1) as lab:
        experiments.register(lab.store, tables.read_frames(frames))
        lab.runner.pool = TwoAtOnce()
        for turn in itertools.islice(itertools.chain(["new"], itertools.repeat("known")), rounds + 1):
            clock, used = timed(lambda: lab.batch(folder / "in.csv", folder / "out.csv"))
            print(f"{rows} mixtures, all {turn}: {clock:.1f} s by the clock, {used:.1f} s of the processor", flush=True)


def main(
    only: Annotated[str | None, typer.Option(help=f"One of {', '.join(PARTS)}.")] = None,
    beds: int = 24,
    runs: int = 1000,
    rows: int = 5000,
    rounds: int = 3,
) -> None:
    """Print the runner's figures."""
    with tempfile.TemporaryDirectory() as folder:
        if only in (None, "processes"):
            processes(Path(folder), beds, rounds)
        if only in (None, "own"):
            own(Path(folder), runs, rounds)
        if only in (None, "cached"):
            cached(Path(folder), rows, rounds)


if __name__ == "__main__":
    typer.run(main)
