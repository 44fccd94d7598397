"""The angle of repose of equal spheres over friction: the curve that the method ``repose`` is calibrated on.

``python tests/validation/repose_table.py`` writes ``docs/repose_table.md``. Its heaps are kept in a store,
``repose_table.db`` in the current folder by default, and are not repeated; in a laboratory's own store they are the
curve of every aggregate without a slip angle. Some ten minutes of one core.
"""

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from pdlab.batch.progress import Progress
from pdlab.batch.runner import Runner
from pdlab.calibration import NODES, REPOSE, Ladder
from pdlab.packing import VERSION
from pdlab.specimen import REPOSE as LIFTED
from pdlab.specimen import Packing
from pdlab.store import open_store

OUT = Path(__file__).parents[2] / "docs" / "repose_table.md"


def main(
    store: str = "repose_table.db",
    seeds: Annotated[int, typer.Option(min=2, help="Heaps of a row.")] = 4,
    out: Path = OUT,
) -> None:
    """Run the heaps of every node and write the table. Raises the first error of a run."""
    runner = Runner(open_store(store), on_progress=lambda p: print(_text(p), end="\r", flush=True))
    lines = [
        "Made by `python tests/validation/repose_table.py`.",
        "",
        f"Engine version {VERSION}, {seeds} heaps a row, protocol `repose`, equal spheres without rolling resistance,",
        "on walls of their own friction. Angle of repose in degrees; seconds a heap, by the clock of a busy machine.",
        "",
        "| μ | angle | standard error | one heap's deviation | contacts per sphere | seconds |",
        "|---|---|---|---|---|---|",
    ]
    for friction in NODES:
        lines.append(_row(friction, runner, seeds))
        print(lines[-1])
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written to {out}")
    runner.close()


def _row(friction: float, runner: Runner, seeds: int) -> str:
    heaps = []
    for outcome in runner(Ladder(REPOSE, ((1.0, 1.0),), LIFTED).beds(friction, seeds)):
        if not isinstance(outcome, Packing):
            raise outcome
        heaps.append(outcome)
    angles = np.array([heap.repose_angle_deg for heap in heaps])
    contacts, seconds = (np.mean([getattr(one, name) for one in heaps]) for name in ("coordination_number", "seconds"))
    deviation = float(angles.std(ddof=1))
    return (
        f"| {friction:g} | {angles.mean():.1f} | {deviation / math.sqrt(seeds):.1f} | {deviation:.1f} | "
        f"{contacts:.2f} | {seconds:.0f} |"
    )


def _text(progress: Progress) -> str:
    return f"{progress.simulated} of {progress.wanted - progress.read} heaps"


if __name__ == "__main__":
    typer.run(main)
