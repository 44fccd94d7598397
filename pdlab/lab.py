"""``Lab``: the verbs in Python, with pandas frames in and out."""

import io
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType

import numpy as np
import pandas as pd

from pdlab import experiments, mixture, store, tables
from pdlab.batch import Progress, Runner, cores
from pdlab.bedfiles import Bed, standing
from pdlab.calibration import SEEDS
from pdlab.errors import InputError, PdlabError
from pdlab.experiments import CalibrationReport, Exported, PredictionReport, Registered
from pdlab.grading import DEFAULT_RULE
from pdlab.specimen import from_canonical

SHIPPED = Path(__file__).parent / "data" / "feret_pebbles"
"""Feret's round pebbles in the table format, with their source in the folder above."""

PREDICTION_COLUMNS = (
    "mixture", "method", "packing_density", "standard_error", "input_error", "expected_error", "measured",
    "difference", "state", "message",
)  # fmt: skip


class Lab:
    """A laboratory's store and the simulations for it.

    ``url``: ``sqlite:///FILE`` or a path; else PDLAB_STORE, else pdlab.db in the current folder. A
    SQLite file that does not exist is made. ``workers``: processes that simulate, one for each core by
    default; they are spawned, so a script calls Lab under ``if __name__ == "__main__":``. ``progress``
    is called after every chunk of simulation. Raises StoreError.
    """

    def __init__(
        self,
        url: str | os.PathLike[str] | None = None,
        workers: int | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self.store = store.open_store(url)
        self.runner = Runner(self.store, workers or cores(), progress)

    def __enter__(self) -> "Lab":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the worker processes and close the store."""
        self.runner.close()
        self.store.close()

    def import_tables(self, path: str | Path, dry_run: bool = False) -> Registered:
        """Import a table, an Excel workbook or a folder of tables, all or nothing.

        ``dry_run``: write nothing, return what would be new. Raises TableError with every problem, each with
        file, row and column.
        """
        return experiments.register(self.store, tables.read_path(Path(path)), dry_run)

    def export_tables(self, path: str | Path) -> Exported:
        """Write all aggregates, sieve analyses, density tests and mixtures to a new folder or an .xlsx file.

        An import of it into an empty store gives the same values, to the last bit; calibrations, predictions
        and runs do not travel. Raises InputError where something would be overwritten.
        """
        return experiments.export_tables(self.store, Path(path))

    def calibrate(
        self, names: Iterable[str] = (), rule: str = DEFAULT_RULE, seeds: int = SEEDS
    ) -> list[CalibrationReport]:
        """Calibrate the named aggregates, or all; an aggregate's error stands in its report."""
        return experiments.calibrate(
            self.store, self.runner, [names] if isinstance(names, str) else list(names), rule, seeds
        )

    def predict_reports(
        self, names: Iterable[str] = (), rule: str = DEFAULT_RULE, seeds: int = mixture.SEEDS
    ) -> list[PredictionReport]:
        """Predict the named mixtures, or all; a mixture's error stands in its report."""
        return experiments.predict(self.store, self.runner, list(names), rule, seeds)

    def predict(
        self, mixtures: pd.DataFrame | Iterable[str] = (), rule: str = DEFAULT_RULE, seeds: int = mixture.SEEDS
    ) -> pd.DataFrame:
        """Predict mixtures: the named, all, or those of a frame like mixtures.csv, which are registered.

        The frame returned has a row for each mixture: its packing density [-] with its errors, the
        measured one and their difference. Raises TableError, UnknownName.
        """
        if isinstance(mixtures, pd.DataFrame):
            brought = tables.read_frame(mixtures.dropna(how="all"), "mixtures")
            experiments.register(self.store, brought)
            names = [record.name for record in brought.mixtures]
        else:
            names = [mixtures] if isinstance(mixtures, str) else list(mixtures)
        return prediction_frame(self.predict_reports(names, rule, seeds))

    def predictions(self) -> pd.DataFrame:
        """Return each mixture's newest prediction beside its measurement."""
        return prediction_frame(experiments.comparisons(self.store))

    def aggregates(self) -> pd.DataFrame:
        """Return the current aggregates: sizes [mm], diameter [mm], measured PD [-], friction [-].

        The friction is empty until the current tests are calibrated.
        """
        rows = [
            {
                "aggregate": one.name,
                "delivery": one.delivery,
                "finest_mm": one.grading.apertures[-1] if one.grading else None,
                "coarsest_mm": one.grading.apertures[0] if one.grading else None,
                "diameter_mm": one.diameter,
                "packing_density": one.measured.packing_density if one.measured else None,
                "friction": one.friction,
                "friction_low": one.friction_low,
                "friction_high": one.friction_high,
                "message": one.message,
            }
            for one in experiments.summaries(self.store)
        ]
        return pd.DataFrame(rows)

    def mixtures(self) -> pd.DataFrame:
        """Return the mixtures: a row for each of their aggregates, with its share [-]."""
        with self.store.read() as session:
            rows = store.mixtures(session)
        return pd.DataFrame(
            [
                {"mixture": row.name, "aggregate": part.aggregate.name, "solid_volume_share": part.solid_volume_share}
                for row in rows
                for part in row.components
            ]
        )

    def runs(self) -> pd.DataFrame:
        """Return the simulated beds, the newest first."""
        columns = (
            "specimen_hash", "state", "spheres", "seed", "packing_density", "coordination_number", "steps", "seconds",
            "rest", "engine_version",
        )  # fmt: skip
        with self.store.read() as session:
            rows = store.runs(session)
        return pd.DataFrame([{name: getattr(row, name) for name in columns} for row in rows], columns=list(columns))

    def bed(self, run: str) -> Bed:
        """Return where the spheres of a run lie; a failed run's as it was left, for inspection.

        ``run``: the beginning of its specimen hash, 4 characters or more. Raises UnknownName,
        ProtocolError.
        """
        with self.store.read() as session:
            row, kept = store.find_bed(session, run)
        specimen = from_canonical(row.specimen)
        with np.load(io.BytesIO(kept.archive)) as archive:
            place, species = standing(specimen, archive["place"]), archive["species"]
        return Bed(specimen, place, species, row.specimen_hash, row.state, row.error)


def prediction_frame(reports: Iterable[PredictionReport]) -> pd.DataFrame:
    """Return reports as a frame with a row each."""
    rows = [{name: getattr(report, name) for name in PREDICTION_COLUMNS} for report in reports]
    return pd.DataFrame(rows, columns=list(PREDICTION_COLUMNS))


__all__ = ["SHIPPED", "InputError", "Lab", "PdlabError", "prediction_frame"]
