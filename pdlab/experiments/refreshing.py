"""Calibrate and predict again what rests on an older engine, and say what that changed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pdlab import store
from pdlab.errors import PdlabError
from pdlab.experiments.calibrations import CalibrationReport, calibrating, calibration_report
from pdlab.experiments.comparisons import comparisons
from pdlab.experiments.predictions import predict
from pdlab.experiments.readings import older_engine
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.ways import Way, way_of
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Calibration
from pdlab.plan import RunAll, finish
from pdlab.store import Store


@dataclass(frozen=True)
class Refreshed:
    """A mixture's packing density [-] or an aggregate's friction coefficient [-] before and after.

    The standard errors are those of the simulation alone, since the measurements are the same ones; None where
    the curve leaves them open. ``error`` stands in the place of what could not be worked out again.
    """

    kind: str
    name: str
    before: float | None
    before_version: int | None
    before_error: float | None
    after: float | None = None
    after_error: float | None = None
    error: PdlabError | None = None

    @property
    def difference(self) -> float | None:
        """After minus before [-]."""
        return None if self.before is None or self.after is None else self.after - self.before

    @property
    def standard_error(self) -> float | None:
        """Standard error of the difference [-]: two simulations that share no run."""
        if self.before_error is None or self.after_error is None:
            return None
        return math.hypot(self.before_error, self.after_error)

    @property
    def label(self) -> str:
        """What was worked out again: its kind and name."""
        return f"{self.kind} {self.name}"


def refresh(target: Store, run_all: RunAll, engine_version: int, names: Sequence[str] = ()) -> list[Refreshed]:
    """Calibrate and predict again, by the method and rule of before, what rests on an engine older than this version.

    All of it, or the named mixtures with their aggregates. The rows of before stay in the store. What cannot be
    worked out again is reported with its error. Raises UnknownName.
    """
    with target.read() as session:
        blends = store.mixtures(session, names)
        fits = _older_fits(store.calibrations(session), engine_version)
    wanted = {blend.name for blend in blends}
    before = [
        report
        for report in comparisons(target, engine_version)
        if report.mixture in wanted and report.state != "failed" and older_engine(report.engine_version, engine_version)
    ]
    parts = {part.aggregate_id for blend in blends for part in blend.components}
    fits = [fit for fit in fits if not names or fit.aggregate_id in parts]
    predicted, calibrated = dict[tuple[str, Way], PredictionReport](), dict[tuple[int, Way], CalibrationReport]()
    for way in dict.fromkeys(_way_of_prediction(report) for report in before):
        names = [report.mixture for report in before if _way_of_prediction(report) == way]
        predicted |= {(report.mixture, way): report for report in predict(target, run_all, names, way)}
    for way in dict.fromkeys(way_of(fit) for fit in fits):
        rows = [fit.aggregate for fit in fits if way_of(fit) == way]
        reports = finish(calibrating(target, rows, way, engine_version), run_all)
        calibrated |= {(report.aggregate_id, way): report for report in reports}
    return [_of_aggregate(fit, calibrated[fit.aggregate_id, way_of(fit)]) for fit in fits] + [
        _of_mixture(report, predicted[report.mixture, _way_of_prediction(report)]) for report in before
    ]


def _way_of_prediction(report: PredictionReport) -> Way:
    return Way(report.method, report.rule or DEFAULT_RULE, leave_out=report.leave_out)


def _older_fits(fits: Sequence[Calibration], engine_version: int) -> list[Calibration]:
    """Return the last calibration of each aggregate by each method, where it is done and of an older engine."""
    last: dict[tuple[int, str], Calibration] = {}
    for fit in fits:
        if not fit.variant:
            last.setdefault((fit.aggregate_id, fit.method), fit)
    ordered = [last[key] for key in sorted(last)]
    return [fit for fit in ordered if fit.state == "done" and older_engine(fit.engine_version, engine_version)]


def _of_mixture(before: PredictionReport, after: PredictionReport) -> Refreshed:
    return Refreshed(
        "mixture", before.mixture, before.packing_density, before.engine_version, before.standard_error,
        after.packing_density, after.standard_error, after.error,
    )  # fmt: skip


def _of_aggregate(fit: Calibration, after: CalibrationReport) -> Refreshed:
    before = calibration_report(fit.aggregate, fit)
    return Refreshed(
        "aggregate", before.aggregate, before.result.value if before.result else None, fit.engine_version,
        _friction_error(before), after.result.value if after.result else None, _friction_error(after), after.error,
    )  # fmt: skip


def _friction_error(report: CalibrationReport) -> float | None:
    """Return the standard error of μ [-] from the curve's: over the slope that the interval of μ shows."""
    result = report.result
    if result is None or result.low is None or result.high is None or result.input_error == 0.0:
        return None
    return result.curve_error * (result.high - result.low) / (2.0 * result.input_error)
