"""How fast a large store answers: opening, a page of each list under each condition and order, one mixture.

``python tests/benchmarks/store_speed.py [FILE]``: builds a store of 200 000 runs, 20 000 mixtures and 50 000
predictions in FILE (in a temporary folder by default), or takes the one that is there. Each time is the least
of three calls in one process, in ms of the processor, which are those of the clock where nothing else runs; of the
conditions and orders the slowest is named.
"""

import datetime as dt
import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import sqlalchemy as sa

from pdlab import experiments, store
from pdlab.calibration import METHOD
from pdlab.grading import SieveRow, SieveTable
from pdlab.models import Base
from pdlab.store import Store

RUNS, MIXTURES, PREDICTIONS, AGGREGATES, DELIVERIES = 200_000, 20_000, 50_000, 500, 3
BEGIN = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
ENGINE = 3
CHUNK = 5_000
APERTURES = (31.5, 16.0, 8.0, 4.0, 2.0, 1.0)
METHODS = (("monosized",), ("graded", "monosized_rolling", "auto", "monosized"), ("static", "toufar", "repose", "auto"))
"""By what each mixture is predicted: first, later one of these, and later still one of those."""
VARIANTS = ("local_damping=0", "pair_friction=mean", "diameter_rule=harmonic")
SPECIMEN = '{"species": [' + '{"diameter": 1.0, "friction": 0.1308, "share": 0.5}, ' * 12 + '"width": 20.0}'
"""As long as a specimen of two aggregates."""

CONDITIONS = {str: ("=", "!=zz", "~o"), float: ("=", ">0.6", ">1e12"), dt.date: ("=", ">2026-02-01")}
"""What each column is compared with, by its kind: all rows, some and none meet them."""

Rows = Iterator[dict[str, Any]]


def build(target: Store, scale: float = 1.0, seed: int = 1) -> None:
    """Fill an empty store with rows that look like a laboratory's, ``scale`` [-] times the whole size."""
    draw = np.random.default_rng(seed)
    runs, mixtures, predictions, names = (
        max(1, round(scale * count)) for count in (RUNS, MIXTURES, PREDICTIONS, AGGREGATES)
    )
    digests = [draw.bytes(32).hex() for _ in range(runs)]
    gradings = [_grading(draw) for _ in range(names * DELIVERIES)]
    tables = {
        "aggregate": _aggregates(names),
        "sieve_analysis": _analyses(gradings),
        "sieve_result": _sieves(gradings),
        "mixture": ({"id": k, "name": f"mix {k:05d}", "version": 1 + (k % 50 == 0)} for k in range(1, mixtures + 1)),
        "mixture_component": _components(mixtures, names),
        "packing_test": _tests(names, mixtures, draw),
        "run": _runs(digests, draw),
        "calibration": _calibrations(names, draw),
        "calibration_run": _links("calibration_id", names * DELIVERIES, digests, draw),
        "prediction": _predictions(predictions, mixtures, draw),
        "prediction_run": _links("prediction_id", predictions, digests, draw),
        "prediction_calibration": _sources(predictions, mixtures, names),
        "correction": _corrections(mixtures),
    }
    with target.write() as session:
        for table, rows in tables.items():
            while chunk := list(itertools.islice(rows, CHUNK)):
                session.execute(sa.insert(Base.metadata.tables[table]), chunk)


def _aggregates(names: int) -> Rows:
    for k in range(names * DELIVERIES):
        yield {
            "id": k + 1, "name": f"gravel {k % names:04d}", "delivery": f"delivery {k // names}",
            "particle_density_kg_m3": 2600.0 + k % 100, "density_basis": ("oven_dry", "ssd", "apparent")[k % 3],
            "water_absorption_percent": 1.5, "source": f"pit {k % 7}",
        }  # fmt: skip


def _grading(draw: np.random.Generator) -> SieveTable:
    held = [0.0, *map(float, 100.0 * draw.dirichlet(np.ones(len(APERTURES) - 1)))]
    return SieveTable(tuple(map(SieveRow, APERTURES, held)), "retained_percent")


def _analyses(gradings: list[SieveTable]) -> Rows:
    for k, table in enumerate(gradings, 1):
        yield {"id": k, "aggregate_id": k, "kind": table.kind} | store.sizes(table)


def _sieves(gradings: list[SieveTable]) -> Rows:
    for k, table in enumerate(gradings, 1):
        for position, row in enumerate(table.rows):
            yield {
                "sieve_analysis_id": k, "position": position, "aperture_mm": row.aperture,
                "retained_percent": row.value, "raw_text": f"{row.aperture}\t{row.value}",
            }  # fmt: skip


def _parts(mixture: int, names: int) -> tuple[int, int]:
    """Return the two aggregates of a mixture, of any delivery."""
    first, count = 7 * mixture, names * DELIVERIES
    return first % count + 1, (first + 1 + mixture % (count - 1)) % count + 1


def _components(mixtures: int, names: int) -> Rows:
    for k in range(1, mixtures + 1):
        for position, part in enumerate(_parts(k, names)):
            yield {
                "mixture_id": k,
                "position": position,
                "aggregate_id": part,
                "solid_volume_share": (0.6, 0.4)[position],
            }


def _tests(names: int, mixtures: int, draw: np.random.Generator) -> Rows:
    """Tests: of each aggregate, of each tenth anew; of mixtures by bulk density or voids, of each tenth none."""
    rest = {"compaction": "loose", "raw_text": "", "voids_percent": None, "bulk_density_kg_m3": None}
    for k in range(1, names * DELIVERIES + 1):
        density = 1500.0 + 100.0 * float(draw.random())
        yield rest | {"aggregate_id": k, "mixture_id": None, "bulk_density_kg_m3": density}
    for k in range(10, names * DELIVERIES + 1, 10):  # which makes the calibrations outdated
        yield rest | {"aggregate_id": k, "mixture_id": None, "voids_percent": 40.0}
    for k in range(1, mixtures + 1):
        value = float(draw.random())
        kind = {"bulk_density_kg_m3": 1600.0 + 150.0 * value} if k % 2 else {"voids_percent": 33.0 + 5.0 * value}
        if k % 10:
            yield rest | {"aggregate_id": None, "mixture_id": k} | kind


def _runs(digests: list[str], draw: np.random.Generator) -> Rows:
    for k, digest in enumerate(digests):
        done = draw.random() < 0.97
        density = 0.56 + 0.08 * float(draw.random())
        yield {
            "specimen_hash": digest, "specimen": SPECIMEN, "engine_version": 1 + k // 80_000, "numba_version": "0.68.1",
            "processor": "znver4", "seed": k % 8 + 1, "spheres": 2500 + 100 * (k % 40),
            "state": "done" if done else "failed", "packing_density": density if done else None,
            "coordination_number": 4.5 + float(draw.random()) if done else None, "height": 20.0,
            "slab_shares": "[0.5, 0.5]", "largest_overlap": 0.005, "rest": "still" if done else None,
            "steps": 17_000 + k % 5000, "seconds": 2.0 + float(draw.random()), "error": None if done else "not at rest",
            "created_at": BEGIN + dt.timedelta(minutes=k), "finished_at": BEGIN + dt.timedelta(minutes=k + 1),
        }  # fmt: skip


def _calibrations(names: int, draw: np.random.Generator) -> Rows:
    for k in range(1, names * DELIVERIES + 1):
        friction = 0.05 + 0.5 * float(draw.random())
        yield {
            "id": k, "aggregate_id": k, "sieve_analysis_id": k, "packing_test_id": k, "method": METHOD,
            "protocol": "{}", "engine_version": ENGINE, "diameter_rule": "log_mean", "diameter_mm": 4.0 + k % 20,
            "measured_packing_density": 0.6, "friction": friction, "friction_low": 0.9 * friction,
            "friction_high": 1.1 * friction, "packing_density": 0.6, "input_error": 0.005, "curve_error": 0.001,
            "state": "done", "progress": 1.0, "requested_at": BEGIN + dt.timedelta(minutes=k),
        }  # fmt: skip


def _mixture(prediction: int, mixtures: int) -> int:
    """Return the mixture of a prediction: each has several, asked for long after one another."""
    return prediction * 7919 % mixtures + 1


def _predictions(count: int, mixtures: int, draw: np.random.Generator) -> Rows:
    """Predictions by several methods; one of 25 is a variant, has failed, or has a warning."""
    for k in range(1, count + 1):
        methods = METHODS[min((k - 1) // mixtures, 2)]
        variant, failed, warned = draw.random(3) < 0.04
        yield {
            "id": k, "mixture_id": _mixture(k, mixtures), "method": methods[draw.integers(len(methods))],
            "variant": VARIANTS[k % 3] if variant else "", "protocol": "{}", "engine_version": ENGINE,
            "packing_density": None if failed else 0.6 + 0.08 * float(draw.random()),
            "standard_error": None if failed else 0.001, "input_error": None if failed else 0.004,
            "state": "failed" if failed else "done", "message": "a bed did not come to rest" if failed else None,
            "warnings": "moist material" if warned else None,
            "progress": 1.0, "requested_at": BEGIN + dt.timedelta(minutes=k),
        }  # fmt: skip


def _corrections(mixtures: int) -> Rows:
    """A share of every 50th mixture and a result of as many sieve analyses, half of them before what rests on them."""
    for k in range(50, mixtures + 1, 50):
        at = {"corrected_by": "A. Miller", "corrected_at": BEGIN + dt.timedelta(days=1 if k % 100 else 20)}
        share = {"table_name": "mixture_component", "row_key": f"{k}/0", "column_name": "solid_volume_share"}
        sieve = {"table_name": "sieve_result", "row_key": f"{k // 50}/1", "column_name": "retained_percent"}
        yield share | at | {"old_value": "0.06", "new_value": "0.6"}
        yield sieve | at | {"old_value": "200.0", "new_value": "20.0"}


def _links(key: str, count: int, digests: list[str], draw: np.random.Generator) -> Rows:
    """Four runs for each."""
    for k in range(1, count + 1):
        for place in draw.choice(len(digests), 4, replace=False):
            yield {key: k, "specimen_hash": digests[place]}


def _sources(predictions: int, mixtures: int, names: int) -> Rows:
    for k in range(1, predictions + 1):
        for part in _parts(_mixture(k, mixtures), names):
            yield {"prediction_id": k, "calibration_id": part}


def spent(call: Callable[[], Any], times: int = 3) -> float:
    """Return the least processor time of a call [ms]."""
    least = float("inf")
    for _ in range(times):
        begun = time.process_time()
        call()
        least = min(least, 1e3 * (time.process_time() - begun))
    return least


def slowest(target: Store, what: str) -> tuple[float, str]:
    """Return the longest time [ms] of a page under one condition and one order on the columns shown, and which."""
    kinds, shown, found = store.column_kinds(what), store.SHOWN[what], list[tuple[float, str]]()
    for column, order, sign in itertools.product(shown, shown, ("", "-")):
        for rest in CONDITIONS[kinds[column]]:
            times = spent(lambda: experiments.listed(target, what, [column + rest], [], sign + order, 30, ENGINE))  # noqa: B023
            found.append((times, f"{column}{rest} --sort {sign}{order}"))
    return max(found)


def report(target: Store) -> Iterator[str]:
    """Yield a line of the table for each thing timed."""
    yield f"{spent(lambda: store.open_store(target.url).close()):8.1f}  opening the store"
    for what in store.SHOWN:
        yield f"{spent(lambda: experiments.listed(target, what, [], [], '', 30, ENGINE)):8.1f}  {what}: first page"  # noqa: B023
        most, asked = slowest(target, what)
        yield f"{most:8.1f}  {what}: slowest page, {asked}"
        yield f"{spent(lambda: experiments.counted(target, what, [], ENGINE)):8.1f}  {what}: how many there are"  # noqa: B023
    with target.read() as session:
        view = sa.text("SELECT * FROM predicted_vs_measured WHERE mixture = 'mix 00077'")
        yield f"{spent(lambda: session.execute(view).all()):8.1f}  predicted_vs_measured of one mixture"
        digests = [row[0] for row in store.list_rows(session, "runs", ["specimen_hash"], limit=5000)]
    yield f"{spent(lambda: _done(target, digests)):8.1f}  done_runs of {len(digests)} digests"
    yield f"{spent(lambda: experiments.comparisons(target, names=['mix 00077'])):8.1f}  comparison of one mixture"
    yield f"{spent(lambda: experiments.parity(target, most=200)):8.1f}  the page: predicted against measured"
    yield f"{spent(lambda: experiments.summaries(target)):8.1f}  the page: all aggregates"
    yield f"{spent(lambda: experiments.listed(target, 'predictions', [], [], '', None, ENGINE)):8.1f}  all predictions"
    yield f"{spent(lambda: experiments.listed(target, 'runs', [], [], '', None, ENGINE)):8.1f}  all runs"


def _done(target: Store, digests: list[str]) -> Any:
    with target.read() as session:  # anew, or the rows are remembered
        return store.done_runs(session, digests)


def main(path: Path) -> None:
    """Build the store where there is none, and print the table."""
    target = store.open_store(path)
    if target.created:
        build(target)
    print(f"{path.stat().st_size / 1e6:8.0f}  MB: {RUNS} runs, {MIXTURES} mixtures, {PREDICTIONS} predictions")
    for line in report(target):
        print(line, flush=True)
    target.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "lab.db")
