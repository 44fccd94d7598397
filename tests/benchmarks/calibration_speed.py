"""How long calibrations and a prediction take by the clock: from an empty store with the shipped runs and
without, on a filled curve, a second time.

``python tests/benchmarks/calibration_speed.py``, in temporary folders, by all cores: run it on an idle machine.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from pdlab import Lab
from pdlab.experiments import shipped

DENSITIES = (0.56, 0.59, 0.62)
FURTHER = tuple(0.57 + 0.005 * k for k in range(8))
WIDE_PAIR = {"coarse": (60.96, 40.64, 0.6), "fine": (20.32, 10.16, 0.583)}
"""Aggregates of a size ratio of 3.5: apertures [mm] and packing density [-]."""


def tables(aggregates: dict[str, tuple[float, float, float]], mixture: str = "") -> Path:
    """Write aggregates of one sieve class, and a mixture of equal parts of them, as tables; return their folder."""
    folder = Path(tempfile.mkdtemp())
    texts = {
        "aggregates": ["name", *aggregates],
        "sieves": ["aggregate,aperture_mm,passing_percent"],
        "packing_tests": ["material,compaction,packing_density"],
    }
    for name, (upper, lower, density) in aggregates.items():
        texts["sieves"] += [f"{name},{upper},100", f"{name},{lower},0"]
        texts["packing_tests"].append(f"{name},loose,{density}")
    if mixture:
        parts = [f"{mixture},{name},{1.0 / len(aggregates)}" for name in aggregates]
        texts["mixtures"] = ["mixture,aggregate,solid_volume_share", *parts]
    for name, lines in texts.items():
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def timed(what: str, call: Callable[[], object], times: int = 1) -> None:
    """Call and print the least of the seconds that it takes."""
    spent = []
    for _ in range(times):
        begun = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begun)
    print(f"{min(spent):9.3f} s  {what}", flush=True)


def timed_first(store: Path, density: float, what: str) -> None:
    """Print how long the first calibration in a new store takes."""
    with Lab(store) as lab:
        lab.import_tables(tables({"one": (16.0, 8.0, density)}))
        timed(f"PD {density} {what}", lab.calibrate)


def main() -> None:
    """Print every time."""
    with tempfile.TemporaryDirectory() as folder:
        for density in DENSITIES:
            timed_first(Path(folder) / f"{density}.db", density, "from an empty store, on the shipped runs")
        shipped.TABLE = Path(folder) / "none" / "runs.csv"
        shipped.write_table(shipped.TABLE, [])
        for density in DENSITIES:
            timed_first(Path(folder) / f"{density} alone.db", density, "from an empty store, without the shipped runs")
        with Lab(f"{folder}/filled.db") as lab:
            lab.import_tables(tables({"dense": (16.0, 8.0, 0.62), "loose": (16.0, 8.0, 0.56)}))
            lab.calibrate()
            for density in FURTHER:
                name = f"further {density:.3f}"
                lab.import_tables(tables({name: (16.0, 8.0, density)}))
                timed(f"{name}, on a filled curve", lambda name=name: lab.calibrate(name))  # type: ignore[misc]
            lab.import_tables(tables(WIDE_PAIR, "pair"))
            lab.calibrate(WIDE_PAIR)
            timed("a binary mixture of size ratio 3.5", lambda: lab.predict("pair"))
            print(lab.predictions(columns=["mixture", "packing_density", "standard_error"]).to_string(index=False))
            timed("the same a second time", lambda: lab.predict("pair"), 5)


if __name__ == "__main__":
    main()
