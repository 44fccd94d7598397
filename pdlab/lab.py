"""``Lab``: the verbs in Python, with pandas frames in and out."""

import datetime as dt
import getpass
import io
import os
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import TracebackType

import numpy as np
import pandas as pd

from pdlab import experiments, mixture, report, store, tables
from pdlab.batch.many import Summary, Survey, Told, in_order, predict_table, survey
from pdlab.batch.pools import open_pool
from pdlab.batch.progress import Progress
from pdlab.batch.runner import Repeater, Runner, cores
from pdlab.batch.working import calibrate, predict
from pdlab.bedfiles import Bed, standing
from pdlab.calibration import METHOD, SEEDS
from pdlab.comparison import CONFIDENCE, SEED
from pdlab.errors import InputError, PdlabError
from pdlab.experiments import (
    SHIPPED,
    CalibrationReport,
    Compared,
    Corrected,
    Exported,
    Facts,
    PredictionReport,
    Refreshed,
    Registered,
    Sheet,
    SweepReport,
    Verified,
    Way,
)
from pdlab.experiments.readings import specimen_kept
from pdlab.frames import PREDICTION_COLUMNS, comparison_frame, prediction_frame, text_row
from pdlab.grading import DEFAULT_RULE
from pdlab.sweep import WISHED_ERROR

Texts = str | Iterable[str]


class Lab:
    """A laboratory's store and the simulations for it.

    ``url``: ``sqlite:///FILE``, a path or ``postgresql://USER@HOST/DATABASE``; else PDLAB_STORE, else
    pdlab.db in the current folder. A SQLite file that does not exist is made. ``workers``: processes that
    simulate, one for each core by default; they are spawned, so a script calls Lab under
    ``if __name__ == "__main__":``. ``progress`` is called after every chunk of simulation. ``threads`` share
    one bed, which pays for few beds of some 10 000 spheres and more on idle cores; results do not depend on
    it. ``scheduler``: ``tcp://HOST:PORT`` of a dask.distributed cluster, whose workers then simulate. Raises
    StoreError, InputError, WorkersLost.
    """

    def __init__(
        self,
        url: str | os.PathLike[str] | None = None,
        workers: int | None = None,
        progress: Callable[[Progress], None] | None = None,
        threads: int = 1,
        scheduler: str | None = None,
    ) -> None:
        if not 1 <= threads <= cores():
            raise InputError(f"{threads} threads lie outside [1, {cores()}], the cores of this process; choose fewer")
        self._address = store.store_url(url)  # with its password
        self.store = store.open_store(self._address)
        try:
            self.runner = Runner(self.store, open_pool(workers or cores() // threads, scheduler), progress, threads)
        except PdlabError:
            self.store.close()
            raise

    def __enter__(self) -> "Lab":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(wait=error is None)

    def close(self, wait: bool = True) -> None:
        """End the worker processes, after what they work on if ``wait``, and close the store."""
        self.runner.close(wait)
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
        self,
        names: Texts = (),
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        seeds: int = SEEDS,
        leave_out: float | None = None,
    ) -> list[CalibrationReport]:
        """Calibrate the named aggregates, or all; an aggregate's error stands in its report.

        ``method``: monosized, monosized_rolling, graded, or auto, the first of them that reaches an aggregate's
        density; or repose, by its angle of repose. ``rule``: for the equivalent diameter. ``seeds``: beds at a node of
        the curve. ``leave_out``: graded spheres finer than this [mm] are left out. Raises UnknownName, InputError.
        """
        return calibrate(self.runner, _texts(names), Way(method, rule, seeds, leave_out))

    def predict_reports(self, names: Texts = (), way: Way | None = None) -> list[PredictionReport]:
        """Predict the named mixtures, or all; a mixture's error stands in its report."""
        return predict(self.runner, _texts(names), way or Way())

    def predict(
        self,
        mixtures: pd.DataFrame | Iterable[str] = (),
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        seeds: int = mixture.SEEDS,
        leave_out: float | None = None,
    ) -> pd.DataFrame:
        """Predict mixtures: the named, all, or those of a frame like mixtures.csv, which are registered.

        ``method``, ``rule``, ``leave_out``: as in ``calibrate``; or a geometric reference, ``static``,
        ``drop_and_roll`` or ``ordered``, which needs no density test. ``seeds``: also beds of each mixture at first.
        The frame returned has a row for each mixture: its packing density [-] with its errors, the measured one, their
        difference, and what Toufar's theory and the compressible packing model make of it. Raises TableError,
        UnknownName, InputError.
        """
        way = Way(method, rule, seeds, leave_out)
        if not isinstance(mixtures, pd.DataFrame):
            return prediction_frame(self.predict_reports(_texts(mixtures), way))
        table = tables.slices_of_frame(mixtures.dropna(how="all"))
        told, found = dict[int, Told](), list[Survey]()
        for one in predict_table(self.runner, table, way, found.append):
            told[one.number] = one
        if not any(one.fresh for one in told.values()):
            return prediction_frame(told[number].report for number in sorted(told))
        failed = {number: one.report for number, one in told.items() if one.report.error is not None}
        return prediction_frame(in_order(self.runner, table, way, failed))

    def plan(
        self,
        path: str | Path,
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        seeds: int = mixture.SEEDS,
        leave_out: float | None = None,
    ) -> Survey:
        """Say what ``batch`` would run of a table, and what it would cost; nothing is written.

        Raises TableError, InputError.
        """
        table, way = tables.slices(Path(path)), Way(method, rule, seeds, leave_out)
        return [one for one in survey(self.runner, table, way, rehearse=True) if isinstance(one, Survey)][-1]

    def batch(
        self,
        path: str | Path,
        output: str | Path,
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        seeds: int = mixture.SEEDS,
        leave_out: float | None = None,
        on_survey: Callable[[Survey], None] | None = None,
        on_row: Callable[[Told], None] | None = None,
    ) -> Summary:
        """Predict a table of mixtures of any length, CSV or a workbook, into a CSV file, a row for each as it comes.

        What the store knows is read; a table that was stopped goes on where it was when it is begun again. A row that
        fails says why. In the end the file is in the table's order. ``on_survey`` is called when the table has been
        gone through, ``on_row`` for each row. Raises TableError for what is no table of mixtures, InputError for a
        file that is there and no earlier output, StoreError, WorkersLost.
        """
        table, way = tables.slices(Path(path)), Way(method, rule, seeds, leave_out)
        summary, failed, output = Summary(table.count), dict[int, PredictionReport](), Path(output)
        begun, runs, steps = time.monotonic(), self.runner.simulated, self.runner.sphere_steps
        try:
            with tables.Output(output, PREDICTION_COLUMNS) as out:
                for told in predict_table(self.runner, table, way, on_survey):
                    out.write([text_row(told.report)])
                    summary.count(told)
                    if told.report.error is not None:
                        failed[told.number] = told.report
                    if on_row is not None:
                        on_row(told)
        finally:
            summary.runs, summary.sphere_steps = self.runner.simulated - runs, self.runner.sphere_steps - steps
            summary.seconds = time.monotonic() - begun
        if summary.predicted + len(failed):
            with tables.Output(output, PREDICTION_COLUMNS) as out:
                for report in in_order(self.runner, table, way, failed):
                    out.write([text_row(report)])
        return summary

    def sheet(
        self,
        names: Texts = (),
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        seeds: int = mixture.SEEDS,
        leave_out: float | None = None,
    ) -> list[Sheet]:
        """Return how far mixtures' packing densities move with the diameter rule, the damping, the pair's friction.

        The whole chain, calibrations included, is worked out once for each of them; see ``calibrate``.
        """
        way = Way(method, rule, seeds, leave_out)
        return experiments.sheet(self.store, self.runner, _texts(names), way)

    def sweep(
        self,
        names: Texts,
        method: str = METHOD,
        rule: str = DEFAULT_RULE,
        standard_error: float = WISHED_ERROR,
        most: int | None = None,
        seeds: int = SEEDS,
        leave_out: float | None = None,
    ) -> SweepReport:
        """Sweep the proportions of two to five aggregates for their densest mix, by as few beds as it takes.

        ``standard_error`` [-] of the densest mix's PD at which it ends; ``most``: beds at most, by default 12 for two
        aggregates, 30 for three. ``method``, ``rule``, ``seeds``, ``leave_out``: as in ``calibrate``. The report's
        ``result`` holds the curve with its errors, the densest mix and the mix to test in the laboratory next. Raises
        UnknownName, InputError.
        """
        way = Way(method, rule, seeds, leave_out)
        return experiments.sweep_aggregates(self.store, self.runner, _texts(names), way, standard_error, most)

    def compare_report(
        self, names: Texts = (), confidence: float = CONFIDENCE, seed: int = SEED, rule: str = DEFAULT_RULE
    ) -> Compared:
        """Set every method beside the measurements, mixture by mixture; see ``compare``."""
        return experiments.compare(self.store, _texts(names), confidence, seed, rule, self.runner.engine_version)

    def compare(
        self, names: Texts = (), confidence: float = CONFIDENCE, seed: int = SEED, rule: str = DEFAULT_RULE
    ) -> pd.DataFrame:
        """Return how far every method is from the measured mixtures, the named or all: bias and errors in PD [-].

        A row for each method ``over`` the ``common`` mixtures, which all methods have, and over its ``own``; intervals
        by bootstrap of this ``confidence`` and ``seed``; what is fitted leaves the mixture itself out. ``rule``: for
        the theories' equivalent diameter. Raises UnknownName, InputError where nothing is measured.
        """
        return comparison_frame(self.compare_report(names, confidence, seed, rule))

    def aggregates(
        self, where: Texts = (), columns: Texts = (), sort: Texts = (), limit: int | None = None
    ) -> pd.DataFrame:
        """Return the current aggregates: sizes [mm], diameter [mm], measured PD [-], friction [-].

        The friction is empty until the current tests are calibrated. ``where``: conditions like
        ``packing_density>0.6`` (also = != < <= >= and ~, contains), all of them to be met; an empty value means
        missing. ``sort``: column names, a minus before one whose values fall. ``limit``: the most rows. Raises
        ConditionError.
        """
        return self._listed("aggregates", where, columns, sort, limit)

    def mixtures(
        self, where: Texts = (), columns: Texts = (), sort: Texts = (), limit: int | None = None
    ) -> pd.DataFrame:
        """Return the mixtures, a row for each of their aggregates, with its share [-]; see ``aggregates``."""
        return self._listed("mixtures", where, columns, sort, limit)

    def runs(self, where: Texts = (), columns: Texts = (), sort: Texts = (), limit: int | None = None) -> pd.DataFrame:
        """Return the simulated beds, the newest first; see ``aggregates``."""
        return self._listed("runs", where, columns, sort, limit)

    def predictions(
        self, where: Texts = (), columns: Texts = (), sort: Texts = (), limit: int | None = None
    ) -> pd.DataFrame:
        """Return each mixture's newest prediction by each method beside its measurement; see ``aggregates``."""
        return self._listed("predictions", where, columns, sort, limit)

    def count(self, what: str, where: Texts = ()) -> int:
        """Return how many rows of aggregates, mixtures, runs, predictions or corrections meet the conditions.

        Raises ConditionError.
        """
        return experiments.counted(self.store, what, _texts(where), self.runner.engine_version)

    def _listed(self, what: str, where: Texts, columns: Texts, sort: Texts, limit: int | None) -> pd.DataFrame:
        order = ",".join(_texts(sort))
        names, rows = experiments.listed(
            self.store, what, _texts(where), _texts(columns), order, limit, self.runner.engine_version
        )
        return pd.DataFrame.from_records(rows, columns=names)

    def show(self, what: str) -> Facts:
        """Return a row and all that it rests on as nested plain data: down to the raw text of each sieve.

        ``what``: a mixture's or an aggregate's name, a prediction's id, the beginning of a run's hash; or
        ``prediction:12``, ``calibration:3``, ``mixture:M``, ``aggregate:A@DELIVERY``, ``run:ab12``,
        ``sieve_analysis:4``, ``packing_test:5``. ``corrections`` of each row holds its history. Raises UnknownName,
        and InputError where a bare name has several meanings.
        """
        return experiments.show(self.store, what)

    def report(
        self, what: str, path: str | Path | None = None, method: str | None = None, at: dt.datetime | None = None
    ) -> str:
        """Return the lab report of a mixture or an aggregate as HTML, and write it to a new file where one is named.

        ``what``: as in ``show``. ``method``: of the mixture's prediction, by default the one last asked for. ``at``:
        the date of the report, with its zone, by default now. Raises UnknownName, and InputError where a name has
        several meanings, and for a file that is there or no .html.
        """
        if path is not None:
            report.check_new(Path(path))
        text = report.named(self.store, what, method, at)
        if path is not None:
            report.write(text, Path(path))
        return text

    def verify(self, sample: int | None = None, seed: int = 1) -> list[Verified]:
        """Repeat stored runs, all or ``sample`` drawn by ``seed``, and compare; nothing is written.

        To the bit where engine, numba and processor are the same; within three standard errors elsewhere; runs of
        another engine version are counted alone. Raises InputError for a ``sample`` below 1.
        """
        again = Repeater(self.store, self.runner.pool, self.runner.on_progress)
        return experiments.verify(self.store, again.repeat, again.engine_version, sample, seed)

    def refresh(self, mixtures: Iterable[str] = ()) -> list[Refreshed]:
        """Calibrate and predict again what rests on an older engine: all of it, or the named mixtures'.

        Packing densities and friction coefficients [-] before and after; the rows of before stay. Raises
        UnknownName.
        """
        names = [mixtures] if isinstance(mixtures, str) else list(mixtures)
        return experiments.refresh(self.store, self.runner, self.runner.engine_version, names)

    def correct(
        self,
        changes: Mapping[str, Mapping[str, str | float | None]],
        by: str | None = None,
        reason: str | None = None,
        version: int | None = None,
    ) -> list[Corrected]:
        """Correct typing errors of one record, as ``{"aggregate:A": {"particle_density_kg_m3": 2650}}``.

        The rows are named as in ``show``, and ``sieve_result:ID/POSITION`` and ``mixture_component:ID/POSITION``;
        None empties a cell. ``by``: who corrects, by default the login name. ``version``: the record's as it was
        seen. What rests on the record is outdated from then on. Raises UnknownName, EditedMeanwhile where the
        record is of another version now, and InputError for what an import would refuse.
        """
        texts = {
            row: {name: "" if value is None else str(value) for name, value in columns.items()}
            for row, columns in changes.items()
        }
        return experiments.correct(self.store, texts, by or getpass.getuser(), reason, version)

    def delete(self, what: str, by: str | None = None, reason: str | None = None, confirmed: bool = True) -> str:
        """Delete a row that nothing rests on, with its own parts; return how it was named.

        Raises UnknownName, StillNeeded with the names of what rests on it, and InputError unless ``confirmed``.
        """
        return experiments.delete(self.store, what, by or getpass.getuser(), reason, confirmed)

    def corrections(
        self, where: Texts = (), columns: Texts = (), sort: Texts = (), limit: int | None = None
    ) -> pd.DataFrame:
        """Return every correction and deletion of what people entered, the oldest first; see ``aggregates``."""
        return self._listed("corrections", where, columns, sort, limit)

    def backup(self, file: str | Path) -> None:
        """Write the store's state of this moment into a new SQLite file, itself a store, while others write on.

        Raises StoreError for a file that is there already and for a backup that is not sound.
        """
        store.backup(self._address, Path(file))

    def copy(self, target: str | os.PathLike[str]) -> pd.DataFrame:
        """Copy the store into an empty database or a new file, all or nothing, and compare; return its tables.

        ``target``: as ``url``. Raises StoreError for a target that holds anything and for a copy that is not equal.
        """
        return pd.DataFrame(store.copy(self._address, target), columns=["name", "rows", "checksum"])

    def bed(self, run: str) -> Bed:
        """Return where the spheres of a run lie; a failed run's as it was left, for inspection.

        ``run``: the beginning of its specimen hash, 4 characters or more. Raises UnknownName,
        ProtocolError.
        """
        with self.store.read() as session:
            row, kept = store.find_bed(session, run)
        specimen = specimen_kept(row)
        with np.load(io.BytesIO(kept.archive)) as archive:
            place, species = standing(specimen, archive["place"]), archive["species"]
        return Bed(specimen, place, species, row.specimen_hash, row.state, row.error)


def _texts(given: Texts) -> list[str]:
    return [given] if isinstance(given, str) else list(given)


__all__ = ["SHIPPED", "InputError", "Lab", "PdlabError"]
