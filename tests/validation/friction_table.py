"""Packing density of equal spheres over friction, beside the reference, and what the chosen settings cost.

``python tests/validation/friction_table.py`` writes ``docs/friction_table.md``. Its runs are kept in a
store, ``friction_table.db`` in the current folder by default, and are not repeated. Some ten minutes
on two cores.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from pdlab.batch.progress import Progress
from pdlab.batch.runner import Runner
from pdlab.packing import VERSION
from pdlab.specimen import LOOSE, Packing, Protocol, equal_spheres
from pdlab.store import open_store

OUT = Path(__file__).parents[2] / "docs" / "friction_table.md"

REFERENCE = {
    (0.7, 0.0, 0.0): (0.6406, 0.0015, 6.2), (0.7, 0.05, 0.0): (0.618, 0.004, 5.8),
    (0.7, 0.1, 0.0): (0.605, 0.0015, 5.5), (0.7, 0.2, 0.0): (0.590, 0.004, 5.1), (0.7, 0.3, 0.0): (0.578, 0.0015, 4.9),
    (0.7, 0.5, 0.0): (0.564, 0.0015, 4.6), (0.7, 1.0, 0.0): (0.555, 0.0015, 4.5),
    (0.7, 1.0, 0.1): (0.524, 0.004, 4.2), (0.7, 1.0, 0.5): (0.477, 0.004, 3.5),
    (0.0, 0.0, 0.0): (0.642, 0.004, 6.3), (0.0, 0.1, 0.0): (0.622, 0.004, 5.6), (0.0, 0.3, 0.0): (0.598, 0.004, 5.1),
    (0.0, 0.5, 0.0): (0.591, 0.004, 4.85), (0.0, 1.0, 0.0): (0.581, 0.004, 4.7),
}  # fmt: skip
"""PD, its standard error and contacts per sphere by local damping, friction and rolling resistance: an
independent program, 1 to 4 seeds; 2500 equal spheres, periodic width 10 d, cloud 0.25, restitution 0.55."""
SECOND = {0.0: 0.638, 0.05: 0.617, 0.1: 0.604, 0.2: 0.585, 0.3: 0.575, 0.5: 0.562, 1.0: 0.550}
"""PD at α = 0.7 by a second program, whose moments are damped too; ± 0.0014, of 4 seeds."""
SECOND_ERROR = 0.0014
AGREEMENT = 0.006
"""Agreement: within this and twice the joint standard error of one of the two programs."""
SETTINGS = {
    "half the time step": {"steps_per_collision": 20.0},
    "half the nominal overlap": {"nominal_overlap": 0.001},
    "both": {"steps_per_collision": 20.0, "nominal_overlap": 0.001},
}


@dataclass(frozen=True)
class Row:
    """Mean, standard error and the rest of some seeds' beds."""

    density: float
    error: float
    contacts: float
    overlap: float
    seconds: float


def row(packings: Sequence[Packing]) -> Row:
    """Summarise the beds of one setting."""
    density = np.array([packing.packing_density for packing in packings])
    return Row(
        float(density.mean()),
        float(density.std(ddof=1)) / math.sqrt(density.size),
        float(np.mean([packing.coordination_number for packing in packings])),
        max(packing.largest_overlap for packing in packings),
        float(np.mean([packing.seconds for packing in packings])),
    )


def simulate(runner: Runner, friction: float, protocol: Protocol, seeds: int, rolling: float = 0.0) -> Row:
    """Run, or read, the beds of one setting. Raises the first error of a run."""
    packings = []
    for outcome in runner([equal_spheres(friction, seed, protocol, rolling) for seed in range(1, seeds + 1)]):
        if not isinstance(outcome, Packing):
            raise outcome
        packings.append(outcome)
    return row(packings)


def agrees(one: Row, damping: float, friction: float, rolling: float) -> bool:
    """Return whether a row agrees with one of the two programs."""
    density, error, _ = REFERENCE[damping, friction, rolling]
    others = [(density, error)]
    if damping == 0.7 and rolling == 0.0:
        others.append((SECOND[friction], SECOND_ERROR))
    return any(abs(one.density - value) <= AGREEMENT + 2.0 * math.hypot(one.error, sigma) for value, sigma in others)


def main(
    store: str = "friction_table.db",
    seeds: Annotated[int, typer.Option(min=2, help="Beds of a row of the first table.")] = 8,
    settings_seeds: Annotated[int, typer.Option(min=2, help="Beds of a row of the second table.")] = 16,
    out: Path = OUT,
) -> None:
    """Run every setting and write the tables."""
    target = open_store(store)
    runner = Runner(target, on_progress=lambda p: print(_text(p), end="\r", flush=True))
    lines = [
        "Made by `python tests/validation/friction_table.py`.",
        "",
        f"Engine version {VERSION}, {seeds} seeds a row, 2500 equal spheres, protocol `loose` but for α. Reference: an",
        "independent program; second: another, at α = 0.7 without rolling resistance. A row agrees when it lies within",
        "0.006 and twice the joint standard error of one of them.",
        "",
        "| α | μ | μ_r | PD | standard error | reference | second | agrees | contacts per sphere | reference | "
        "largest overlap |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (damping, friction, rolling), (density, error, contacts) in REFERENCE.items():
        one = simulate(runner, friction, Protocol(local_damping=damping), seeds, rolling)
        second = f"{SECOND[friction]:.3f}" if damping == 0.7 and rolling == 0.0 else ""
        verdict = "yes" if agrees(one, damping, friction, rolling) else "no"
        lines.append(
            f"| {damping:g} | {friction:g} | {rolling:g} | {one.density:.4f} | {one.error:.4f} | "
            f"{density:.4g} ± {error:g} | {second} | {verdict} | {one.contacts:.2f} | {contacts:g} | "
            f"{one.overlap:.2%} |"
        )
        print(lines[-1])
    lines += [
        "",
        f"What the settings cost, {settings_seeds} seeds a row:",
        "",
        "| μ | setting | PD | standard error | change | its standard error |",
        "|---|---|---|---|---|---|",
    ]
    for friction in (0.1, 0.3):
        base = simulate(runner, friction, LOOSE, settings_seeds)
        lines.append(f"| {friction:g} | default | {base.density:.4f} | {base.error:.4f} | | |")
        for name, change in SETTINGS.items():
            one = simulate(runner, friction, Protocol(**change), settings_seeds)
            lines.append(
                f"| {friction:g} | {name} | {one.density:.4f} | {one.error:.4f} | {one.density - base.density:+.4f} | "
                f"{math.hypot(one.error, base.error):.4f} |"
            )
            print(lines[-1])
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written to {out}")


def _text(progress: Progress) -> str:
    return f"{progress.simulated} of {progress.wanted - progress.read} beds"


if __name__ == "__main__":
    typer.run(main)
