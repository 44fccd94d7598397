"""Write the store of the checked-out revision, as SQL, beside this file: run it once when a revision has landed.

    python tests/data/stores/make.py            writes REVISION.sql, never over one that is there

For an older revision: check out a commit that has it, copy this file there, and set PYTHONPATH to that folder.
The rows: the shipped pebbles, calibrated and predicted by a formula instead of simulated beds, one bed, one run that
failed, one wish that waits, a sweep, a draft.
"""

import datetime as dt
import hashlib
import io
import json
import math
import sqlite3
import tempfile
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from pdlab.experiments import Way, predict, register
from pdlab.lab import SHIPPED
from pdlab.models import (
    Calibration,
    Draft,
    Prediction,
    Run,
    RunState,
    Sweep,
    SweepCalibration,
    SweepComponent,
    SweepRun,
)
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store, mixtures, open_store
from pdlab.tables import read_path

ENGINE = 1
MOMENT = dt.datetime(2026, 2, 3, 4, 5, 6, 789, tzinfo=dt.UTC)


def packing(specimen: Specimen) -> Packing:
    """Return what a bed might have given: a PD(μ) that falls, with a scatter of 0.001."""
    digest = specimen.digest(ENGINE)
    scatter = int(hashlib.sha256(digest.encode()).hexdigest()[:8], 16) / 0xFFFFFFFF - 0.5
    friction = min(kind.friction for kind in specimen.species)
    gain = 0.05 * (1.0 - specimen.species[-1].diameter)
    value = 0.55 + 0.09 * math.exp(-3.0 * math.sqrt(friction)) + gain + 0.002 * scatter
    return Packing(digest, value, 5.0, 20.0, specimen.shares, 0.005, "still", 1000, 1.0, ENGINE)


def run(specimen: Specimen, result: Packing) -> Run:
    """Return a run's row."""
    return Run(
        specimen_hash=result.digest, specimen=specimen.canonical(ENGINE), engine_version=ENGINE, numba_version="0.65.1",
        processor="znver4", seed=specimen.seed, spheres=specimen.spheres, state="done",
        packing_density=result.packing_density, coordination_number=5.0, height=20.0,
        slab_shares=json.dumps(result.slab_shares), largest_overlap=0.005, rest="still", steps=1000, seconds=1.0,
        finished_at=MOMENT,
    )  # fmt: skip


def archive() -> bytes:
    """Return a bed of three spheres, as the runner keeps it."""
    out = io.BytesIO()
    np.savez_compressed(out, place=np.arange(12.0).reshape(3, 4), species=np.zeros(3, np.uint8))
    return out.getvalue()


def fill(store: Store) -> None:
    """Write the rows."""

    def run_all(specimens: Sequence[Specimen]) -> list[Packing]:
        results = [packing(specimen) for specimen in specimens]
        with store.write() as session:
            for specimen, result in zip(specimens, results, strict=True):
                session.merge(run(specimen, result))
        return results

    run_all.engine_version = ENGINE  # type: ignore[attr-defined]
    register(store, read_path(SHIPPED))
    predict(store, run_all)
    with store.write() as session:
        first = session.query(Run).order_by(Run.specimen_hash).first()
        assert first is not None
        session.add(RunState(specimen_hash=first.specimen_hash, steps=1000, archive=archive()))
        failed = {"state": "failed", "error": "the bed still moves", "created_at": MOMENT}
        session.add(Run(specimen_hash="f" * 64, specimen="{}", engine_version=ENGINE, seed=7, spheres=3, **failed))
        mixture = mixtures(session)[0]
        wish = Prediction(
            mixture_id=mixture.id, method="monosized", protocol="", asked=Way().text(), requested_at=MOMENT
        )
        session.add(wish)
        session.add(Draft(kind="aggregate", content='{"name": "sand"}', created_at=MOMENT, saved_at=MOMENT))
        fits = session.query(Calibration).order_by(Calibration.id).limit(2).all()
        session.add(
            Sweep(
                method="monosized", asked=Way().text(), wished_error=0.001, most_specimens=12, engine_version=ENGINE,
                packing_density=0.64, standard_error=0.001, input_error=0.004, state="done", progress=1.0,
                requested_at=MOMENT, finished_at=MOMENT, runs=[SweepRun(specimen_hash=first.specimen_hash)],
                components=[
                    SweepComponent(position=k, aggregate_id=fit.aggregate_id, densest_share=0.5, next_share=share)
                    for k, (fit, share) in enumerate(zip(fits, (0.25, 0.75), strict=True))
                ],
                calibrations=[SweepCalibration(calibration_id=fit.id) for fit in fits],
            )
        )  # fmt: skip


def main() -> None:
    """Make the store in a temporary folder and write it as SQL."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(f"{folder}/lab.db")
        fill(store)
        store.close()
        with closing(sqlite3.connect(f"{folder}/lab.db")) as connection:
            (revision,) = connection.execute("SELECT version_num FROM alembic_version").fetchone()
            text = "\n".join(connection.iterdump())
    with (Path(__file__).parent / f"{revision}.sql").open("x", encoding="utf-8") as file:
        file.write(f"{text}\n")


if __name__ == "__main__":
    main()
