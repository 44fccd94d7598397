"""How long it takes to register a table of mixtures: at once and slice by slice, all new and all there already.

``python tests/benchmarks/registration_speed.py [SCALE]``: 5000 mixtures of eight aggregates into a store of ``SCALE``
times 20 000 mixtures and 50 000 predictions (0.1 by default, see ``store_speed.py``). Seconds of the processor.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import store_speed

from pdlab import experiments, tables
from pdlab.store import Store, open_store

MIXTURES = 5000


def blends(beginning: str) -> pd.DataFrame:
    """Return so many mixtures of two aggregates each, whose names begin alike."""
    lines = [
        (f"{beginning} {k}", f"gravel {j:04d}", f"delivery {k % 3}", share)
        for k in range(MIXTURES)
        for j, share in ((k % 7, 0.1 * (k % 9 + 1)), (9, 0.1 * (9 - k % 9)))
    ]
    return pd.DataFrame(lines, columns=["mixture", "aggregate", "delivery", "solid_volume_share"])


def at_once(target: Store, frame: pd.DataFrame) -> None:
    """Register a frame as an import does."""
    experiments.register(target, tables.read_frame(frame, "mixtures"))


def in_slices(target: Store, frame: pd.DataFrame) -> None:
    """Register a frame as a long table is."""
    for part in tables.slices_of_frame(frame):
        experiments.register_each(target, part)


def spent(call: Callable[[], Any]) -> float:
    """Return the processor time of a call [s]."""
    begun = time.process_time()
    call()
    return time.process_time() - begun


def main(scale: float) -> None:
    """Build a store and print a line for each way."""
    with tempfile.TemporaryDirectory() as folder:
        target = open_store(Path(folder) / "lab.db")
        store_speed.build(target, scale)
        for way in (at_once, in_slices):
            frame = blends(way.__name__)
            for state in ("new", "equal"):
                print(f"{spent(lambda: way(target, frame)):6.2f}  {MIXTURES} mixtures {way.__name__}, {state}")  # noqa: B023
        target.close()


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 0.1)
