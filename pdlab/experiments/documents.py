"""What a lab report says of one aggregate or one mixture, as plain data of one state of the store."""

import datetime as dt
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any, cast

from sqlalchemy.orm import Session

from pdlab import density, grading, store
from pdlab.errors import UnknownName
from pdlab.experiments.addresses import find
from pdlab.experiments.comparisons import comparisons
from pdlab.experiments.evidence import (
    AggregateInputs,
    DensityTest,
    ShownCalibration,
    ShownCorrection,
    ShownRun,
    aggregate_inputs,
    calibration_shown,
    density_tests,
    mixture_corrections,
    runs_shown,
    settings_of,
)
from pdlab.experiments.explaining import Explained, explain, waiting_calibration
from pdlab.experiments.lists import listed
from pdlab.experiments.mixing import Composed, composition, waiting_prediction
from pdlab.experiments.readings import is_stale, mean_density, older_engine
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.ways import Way
from pdlab.grading import Grading
from pdlab.models import Calibration, Prediction
from pdlab.store import Store

REPORTED = ("mixture", "aggregate")
"""The kinds of rows that have a report."""
PARITY = 500
"""Comparisons of a store at most that a report draws, the newest."""


@dataclass(frozen=True)
class Versions:
    """By what a report was made: pdlab, the ``store`` and its revision, the newest engine among its runs."""

    pdlab: str
    store: str
    revision: str
    newest_engine: int | None


@dataclass(frozen=True)
class AggregateDocument:
    """An aggregate: what was entered, its last calibration with the curve and the runs.

    ``calibration``: the one that ``explained`` is about, None before one. ``outdated``: why it is not what the store
    would give now. ``waiting``: the method of a calibration that was asked for since and has not ended.
    """

    inputs: AggregateInputs
    explained: Explained
    calibration: ShownCalibration | None
    outdated: tuple[str, ...]
    waiting: str
    versions: Versions

    @property
    def indices(self) -> Mapping[str, float]:
        """What the grading is called by; see ``grading.indices``."""
        return _indices(self.inputs.grading)


@dataclass(frozen=True)
class Amount:
    """A packing density in the unit of a quantity: predicted with its errors and measured, None where unknown."""

    name: str
    predicted: float | None
    standard_error: float | None
    input_error: float | None
    expected_error: float | None
    measured: float | None
    measured_error: float | None


@dataclass(frozen=True)
class MixtureDocument:
    """A mixture: what it is made of, its prediction by one method with what it rests on, those by the others.

    ``mass_shares``: as they were entered, by aggregate, None where shares were by solid volume. ``amounts``: the
    prediction in the units that are asked for. ``settings``: the protocol. ``others``: measured and predicted packing
    densities of the store's other mixtures by this method.
    """

    key: int
    name: str
    entered_at: dt.datetime
    version: int
    composed: Composed
    mass_shares: tuple[float | None, ...]
    tests: tuple[DensityTest, ...]
    corrections: tuple[ShownCorrection, ...]
    parts: tuple[AggregateDocument, ...]
    prediction: PredictionReport
    predictions: tuple[PredictionReport, ...]
    amounts: tuple[Amount, ...]
    versions: Versions
    waiting: str = ""
    finished_at: dt.datetime | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    calibrations: tuple[ShownCalibration, ...] = ()
    runs: tuple[ShownRun, ...] = ()
    others: tuple[tuple[float, float], ...] = ()

    @property
    def all_runs(self) -> tuple[ShownRun, ...]:
        """The runs that the prediction and its calibrations rest on, each once."""
        found = {run.digest: run for fit in self.calibrations for run in fit.runs}
        return tuple((found | {run.digest: run for run in self.runs}).values())

    @property
    def indices(self) -> Mapping[str, float]:
        """What the combined grading is called by; see ``grading.indices``."""
        return _indices(self.composed.combined)


def reported(target: Store, what: str) -> tuple[str, int]:
    """Return the kind, aggregate or mixture, and the id of what a text names, as ``addresses.find`` reads it.

    Raises UnknownName, and InputError where it names several things or what has no report.
    """
    with target.read() as session:
        row = find(session, what, REPORTED)
        return row.__tablename__, int(cast(Any, row).id)


def aggregate_document(target: Store, aggregate_id: int) -> AggregateDocument:
    """Return what a report says of an aggregate. Raises UnknownName."""
    with target.snapshot() as frozen:
        return _aggregate(frozen, aggregate_id, _versions(frozen))


def mixture_document(target: Store, mixture_id: int, method: str | None = None) -> MixtureDocument:
    """Return what a report says of a mixture, by the ``method`` or by the one that it was last predicted by.

    Raises UnknownName, and InputError for what is no method.
    """
    if method is not None:
        Way(method)
    with target.snapshot() as frozen:
        return _mixture(frozen, mixture_id, method)


def _indices(found: Grading | None) -> Mapping[str, float]:
    return {} if found is None else grading.indices(found)


def _versions(target: Store) -> Versions:
    with target.read() as session:
        return Versions(version("pdlab"), target.url, store.head(), store.newest_engine(session))


def _aggregate(target: Store, aggregate_id: int, versions: Versions, also: Sequence[int] = ()) -> AggregateDocument:
    """Return what is said of an aggregate; ``also``: ids of further sieve analyses to show."""
    explained = explain(target, aggregate_id)
    waiting = waiting_calibration(target, aggregate_id)
    fit, outdated = None, tuple[str, ...]()
    if explained.calibration_id is not None:
        with target.read() as session:
            (row,) = store.calibrations_by_id(session, [explained.calibration_id])
            outdated = _outdated(row, versions)
        with target.read() as session:
            fit = _calibration(session, explained.calibration_id)
    with target.read() as session:
        (entered,) = store.aggregates_by_id(session, [aggregate_id])
        analyses = [*also, *([] if fit is None else [fit.sieve_analysis])]
        inputs = aggregate_inputs(session, entered, analyses)
    return AggregateDocument(
        inputs, explained, fit, outdated, waiting.method if waiting is not None else "", versions
    )  # fmt: skip


def _outdated(row: Calibration, versions: Versions) -> tuple[str, ...]:
    stale = "tested or sieved anew since, or corrected: calibrate again" if is_stale(row) else ""
    return tuple(text for text in (stale, older_engine(row.engine_version, versions.newest_engine)) if text)


def _calibration(session: Session, key: int) -> ShownCalibration:
    row = store.find_row(session, Calibration, key)
    assert row is not None, "the snapshot lost a row"
    return calibration_shown(store.with_descent(session, row))


def _mixture(target: Store, mixture_id: int, method: str | None) -> MixtureDocument:
    versions, waiting = _versions(target), waiting_prediction(target, mixture_id)
    with target.read() as session:
        row = next(iter(store.mixtures_by_id(session, [mixture_id])), None)
        if row is None:
            raise UnknownName(f"the store holds no mixture {mixture_id}; choose another")
        last = store.last_prediction(session, mixture_id)
        tests, corrections = density_tests(row.packing_tests, mean_density(row)), mixture_corrections(session, row)
    composed = composition(target, mixture_id)
    reports = comparisons(target, names=[row.name])
    chosen = _chosen(reports, method, last.id if last is not None else 0)
    evidence = _evidence(target, chosen.prediction_id)
    fits: tuple[ShownCalibration, ...] = evidence.get("calibrations", ())
    analyses = [fit.sieve_analysis for fit in fits]
    return MixtureDocument(
        row.id, row.name, row.created_at, row.version, composed, tuple(part.mass_share for part in row.components),
        tests, corrections,
        tuple(_aggregate(target, part.aggregate_id, versions, analyses) for part in row.components),
        chosen, tuple(one for one in reports if one.prediction_id is not None), _amounts(chosen, composed),
        versions, waiting.method if waiting is not None else "",
        others=_others(target, chosen), **evidence,
    )  # fmt: skip


def _chosen(reports: Sequence[PredictionReport], method: str | None, last: int) -> PredictionReport:
    """Return the report of a method, or of the ``last`` prediction where it has ended, or that there is none yet."""
    if method is None:
        return max(reports, key=lambda report: (report.prediction_id == last, report.prediction_id or 0))
    found = next((report for report in reports if report.method == method), None)
    if found is not None and found.prediction_id is not None:
        return found
    open_ = reports[0]
    return PredictionReport(
        open_.mixture, method, measured=open_.measured, measured_error=open_.measured_error, furnas=open_.furnas,
        toufar=open_.toufar, cpm=open_.cpm, theory_message=open_.theory_message, state="open",
        notes=(f"not predicted by '{method}' yet: run 'pdlab predict --method {method}'",),
    )  # fmt: skip


def _evidence(target: Store, prediction_id: int | None) -> dict[str, Any]:
    """Return what a prediction rests on, by the names of a document's fields."""
    with target.read() as session:
        row = None if prediction_id is None else store.find_row(session, Prediction, prediction_id)
        if row is None:
            return {}
        whole = store.with_descent(session, row)
        return {
            "finished_at": whole.finished_at,
            "settings": settings_of(whole),
            "calibrations": tuple(calibration_shown(link.calibration) for link in whole.calibrations),
            "runs": runs_shown([link.run for link in whole.runs]),
        }


def _amounts(report: PredictionReport, composed: Composed) -> tuple[Amount, ...]:
    """Return what was predicted and measured in the units of concrete."""
    particle = composed.particle_density or math.nan
    units: dict[str, Callable[[float], float]] = {
        "packing_density": lambda value: value,
        "voids_percent": density.voids_percent,
        "bulk_density_kg_m3": lambda value: density.bulk_density(value, particle),
        "void_volume": density.void_volume,
    }
    return tuple(
        _amount(name, convert, report)
        for name, convert in units.items()
        if name != "bulk_density_kg_m3" or composed.particle_density is not None
    )


def _amount(name: str, convert: Callable[[float], float], report: PredictionReport) -> Amount:
    """Return a report's packing densities by a linear conversion."""

    def at(value: float | None) -> float | None:
        return None if value is None else convert(value)

    def off(error: float | None) -> float | None:
        return None if error is None else abs(convert(error) - convert(0.0))

    return Amount(
        name, at(report.packing_density), off(report.standard_error), off(report.input_error),
        off(report.expected_error), at(report.measured), off(report.measured_error),
    )  # fmt: skip


def _others(target: Store, report: PredictionReport) -> tuple[tuple[float, float], ...]:
    """Return the newest comparisons of other mixtures by the same method: measured and predicted."""
    if report.packing_density is None:
        return ()
    where = [f"method={report.method}", "state=done", "difference!="]
    names = ["mixture", "measured", "packing_density"]
    _, rows = listed(target, "predictions", where, names, "-mixture_id", PARITY)
    return tuple((measured, predicted) for name, measured, predicted in rows if name != report.mixture)
