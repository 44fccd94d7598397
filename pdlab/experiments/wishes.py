"""Wishes: calibrations, predictions and sweeps that are asked for, and how a runner answers them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from pdlab import store
from pdlab.errors import InputError, PdlabError, StoreError, UnknownName
from pdlab.experiments.calibrations import CalibrationReport, calibrating, calibration_report
from pdlab.experiments.opening import open_calibration
from pdlab.experiments.predictions import answered, predicting
from pdlab.experiments.reports import PredictionReport, reports_of
from pdlab.experiments.sweeps import SweepReport, read_sweep, sweeping
from pdlab.experiments.sweeps import report_of as report_of_sweep
from pdlab.experiments.ways import Way, way_kept
from pdlab.models import Aggregate, Calibration, Mixture, Prediction, Sweep, SweepComponent
from pdlab.plan import Plan, at_once
from pdlab.store import Claim, Key, Store
from pdlab.sweep import MOST, check_aggregates, check_wish

Report = CalibrationReport | PredictionReport | SweepReport


R = TypeVar("R", CalibrationReport, PredictionReport)


@dataclass(frozen=True)
class Asked(Generic[R]):
    """What a call asks for, by aggregate or mixture: the reports that are there, and the wishes for the others.

    ``own``: the wishes that were not there already.
    """

    reports: Mapping[int, R]
    wishes: Mapping[int, Key]
    own: Sequence[Key]


def ask_calibrations(
    target: Store, rows: Sequence[Aggregate], way: Way, engine_version: int, priority: int = 0
) -> Asked[CalibrationReport]:
    """Read calibrations of aggregates, or work them out of the curves that are there; wish for the others."""
    reports, asked = dict[int, CalibrationReport](), list[tuple[int, dict[str, object]]]()
    for row in rows:
        found = at_once(calibrating(target, [row], way, engine_version))
        if found is not None:
            reports[row.id] = found[0]
        else:
            facts = open_calibration(row, way).facts()
            asked.append((row.id, facts | {"method": way.method, "asked": way.text(), "priority": priority}))
    same = ("aggregate_id", "method", "variant", "asked", "sieve_analysis_id", "packing_test_id")
    if not asked:
        return Asked(reports, {}, ())
    with target.write() as session:
        ids, own = store.ask(session, "calibration", [facts for _, facts in asked], same)
    wishes = {key: ("calibration", wish) for (key, _), wish in zip(asked, ids, strict=True)}
    return Asked(reports, wishes, [("calibration", wish) for wish in own])


def ask_predictions(
    target: Store, rows: Sequence[Mixture], way: Way, engine_version: int, priority: int = 0
) -> Asked[PredictionReport]:
    """Read the predictions of mixtures that are there; wish for the others."""
    reports = answered(target, rows, way, engine_version)
    missing = [row.id for row in rows if row.id not in reports]
    if not missing:
        return Asked(reports, {}, ())
    facts = {"method": way.method, "variant": way.variant, "asked": way.text(), "priority": priority, "protocol": ""}
    with target.write() as session:
        same = ("mixture_id", "method", "variant", "asked")
        wished = [facts | {"mixture_id": key} for key in missing]
        ids, own = store.ask(session, "prediction", wished, same)
    wishes = {key: ("prediction", wish) for key, wish in zip(missing, ids, strict=True)}
    return Asked(reports, wishes, [("prediction", wish) for wish in own])


def ask_sweep(
    target: Store,
    rows: Sequence[Aggregate],
    way: Way,
    wished_error: float,
    most_specimens: int | None,
    engine_version: int,
    priority: int = 0,
) -> SweepReport | Key:
    """Read the sweep of aggregates that is there; else return the wish for it. Raises InputError."""
    check_aggregates(len(rows))
    most = MOST[len(rows)] if most_specimens is None else most_specimens
    check_wish(wished_error, most)
    found = read_sweep(target, rows, way, wished_error, most, engine_version)
    if found is not None:
        return found
    facts = {
        "method": way.method, "variant": way.variant, "asked": way.text(), "wished_error": wished_error,
        "most_specimens": most,
    }  # fmt: skip
    ids = [row.id for row in rows]
    with target.write() as session:
        waiting = store.waiting_sweeps(session, ids, facts)
        if waiting:
            return "sweep", waiting[0].id
        parts = [SweepComponent(position=k, aggregate_id=key) for k, key in enumerate(ids)]
        wish = Sweep(priority=priority, components=parts, **facts)
        store.add_all(session, [wish])
        return "sweep", wish.id


def answering(target: Store, key: Key, who: str, engine_version: int) -> Plan[Report]:
    """Work out what a wish asks for and write it into its row; what cannot be stands there with its reason.

    ``who``: the runner that claimed it. Raises ClaimLost.
    """
    kind, row_id = key
    claim = Claim(row_id, who)
    try:
        if kind == "calibration":
            report: Report = yield from _calibrating(target, claim, engine_version)
        elif kind == "sweep":
            report = yield from _sweeping(target, claim, engine_version)
        else:
            report = yield from _predicting(target, claim, engine_version)
    except StoreError:
        raise
    except InputError as error:  # what was asked for is gone or cannot be
        with target.write() as session:
            store.end_wish(session, key, who, "failed", str(error))
        raise
    if report.error is not None:
        with target.write() as session:
            store.end_wish(session, key, who, "failed", str(report.error))
    return report


def _calibrating(target: Store, claim: Claim, engine_version: int) -> Plan[CalibrationReport]:
    with target.read() as session:
        wish = store.claimed(session, Calibration, claim)
        way = way_kept(wish)
        rows = store.aggregates_by_id(session, [wish.aggregate_id])
    reports = yield from calibrating(target, rows, way, engine_version, claim)
    return reports[0]


def _predicting(target: Store, claim: Claim, engine_version: int) -> Plan[PredictionReport]:
    with target.read() as session:
        wish = store.claimed(session, Prediction, claim)
        way = way_kept(wish)
        rows = store.mixtures_by_id(session, [wish.mixture_id])
    reports = yield from predicting(target, rows, way, engine_version, claim)
    return reports[0]


def _sweeping(target: Store, claim: Claim, engine_version: int) -> Plan[SweepReport]:
    with target.read() as session:
        wish = store.claimed(session, Sweep, claim)
        way = way_kept(wish)
        ids, wished_error, most = store.swept(wish), wish.wished_error, wish.most_specimens
        known = {row.id: row for row in store.aggregates_by_id(session, ids)}
    rows = [known[key] for key in ids]
    report = yield from sweeping(target, rows, way, wished_error, most, engine_version, claim)
    return report


def report_on(target: Store, key: Key) -> Report:
    """Return what became of a wish that another runner answered, or that was cancelled. Raises UnknownName."""
    kind, row_id = key
    if kind == "prediction":
        report = reports_of(target, [row_id])[row_id]
        return report if report.state == "done" else _with_error(report)
    if kind == "sweep":
        swept = report_of_sweep(target, row_id)
        error = None if swept.state == "done" else PdlabError("; ".join(swept.notes) or f"the sweep is {swept.state}")
        return replace(swept, error=error)
    with target.read() as session:
        row = next(iter(store.calibrations_by_id(session, [row_id])), None)
    if row is None:
        raise UnknownName(f"{kind} {row_id} was deleted while it was waited for; ask again")
    error = None if row.state == "done" else PdlabError(row.message or f"the calibration is {row.state}")
    found = calibration_report(row.aggregate, row)
    return found if error is None else CalibrationReport(found.aggregate, found.aggregate_id, row_id, error=error)


def _with_error(report: PredictionReport) -> PredictionReport:
    return replace(report, error=PdlabError(report.message or f"the prediction is {report.state}"))


def cancel(target: Store, keys: Sequence[Key], message: str = "cancelled") -> int:
    """Cancel wishes that have not ended; return how many that were."""
    with target.write() as session:
        return store.cancel(session, keys, message)
