"""How well runs are planned: estimates beside what the runs of real stores took.

``python tests/benchmarks/planning.py STORE...``: for the runs of all the stores, done by the newest engine, the ratio
of the estimate to the actual, its median and the ends of the interval that holds 90 % of them: of each run's steps and
seconds, by what is built in, by all others, and by all others but those of the same bed; then of the sums of many
runs, planned by none, few or many others, and how often they lay within the range that was given.
"""

import sys
from collections.abc import Iterator, Sequence

import numpy as np

from pdlab import planning
from pdlab.experiments import known_runs
from pdlab.planning import Ran
from pdlab.store import open_store

SUMS, EACH = 200, 40
"""Sums of runs that are planned, and runs of each."""


def line(what: str, ratios: Sequence[float], *more: str) -> str:
    """Return the median and the ends of the middle 90 % of ratios of estimate to actual."""
    low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
    return "  ".join([f"{what:42} {len(ratios):5}   {middle:5.2f}   {low:5.2f} to {high:5.2f}", *more])


def planned(bed: Ran, others: Sequence[Ran]) -> tuple[float, float]:
    """Return a run's estimated steps and seconds over those that it took."""
    steps, seconds, _ = planning.learn(others).run(bed.specimen)
    return steps / max(bed.steps, 1), seconds / (bed.seconds or np.nan)


def ratios(runs: Sequence[Ran]) -> Iterator[str]:
    """Yield lines for single runs."""
    at = np.array([planning.features(run.specimen) for run in runs])
    ways = {
        "nothing but what is built in": lambda k: [],
        "all other runs": lambda k: [run for j, run in enumerate(runs) if j != k],
        "all runs of other beds": lambda k: [
            run for run, place in zip(runs, at, strict=True) if np.linalg.norm(place - at[k]) > planning.ALIKE
        ],
    }
    for name, others in ways.items():
        some = range(0, len(runs), max(1, len(runs) // 60))
        found = np.array([planned(runs[k], others(k)) for k in some])
        moved = np.array([runs[k].steps > 0 for k in some])
        yield line(f"steps, by {name}", found[moved, 0])
        yield line(f"seconds, by {name}", found[:, 1])


def sums(runs: Sequence[Ran], learned: int) -> Iterator[str]:
    """Yield lines for sums of runs drawn at random, planned by others."""
    draw, steps, seconds, within = np.random.default_rng(1), [], [], np.zeros(2)
    for _ in range(SUMS):
        order = draw.permutation(len(runs))
        taken, others = [runs[k] for k in order[:EACH]], [runs[k] for k in order[EACH : EACH + learned]]
        made = planning.estimate([run.specimen for run in taken], others)
        actual = sum(run.steps * run.specimen.spheres for run in taken), sum(run.seconds or 0.0 for run in taken)
        for ratio, expected, value in zip((steps, seconds), (made.sphere_steps, made.seconds()), actual, strict=True):
            ratio.append(expected.value / value)
            within += np.array([ratio is steps, ratio is seconds]) * (expected.low <= value <= expected.high)
    for name, found, inside in zip(("sphere-steps", "seconds"), (steps, seconds), within, strict=True):
        yield line(f"{name} of {EACH} runs, by {learned}", found, f"{inside / SUMS:4.0%} within the range")


def main(paths: Sequence[str]) -> None:
    """Print the table."""
    runs = list[Ran]()
    for path in paths:
        target = open_store(path)
        runs += known_runs(target)
        target.close()
    print(f"{len(runs)} runs; ratio of estimate to actual: median, middle 90 %")
    for text in (*ratios(runs), *sums(runs, 0), *sums(runs, 10), *sums(runs, len(runs))):
        print(text, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
