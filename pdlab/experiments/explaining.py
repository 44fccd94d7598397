"""A calibration explained: the curve that it rests on with its runs, what was measured, which method and why."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from sqlalchemy.orm import Session

from pdlab import calibration, store
from pdlab.calibration import ANGLE, GRADED, MONOSIZED, REPOSE, ROLLING, Curve, Ladder
from pdlab.errors import InputError, PdlabError, UnknownName
from pdlab.experiments.calibrations import calibration_report
from pdlab.experiments.curves import Curves
from pdlab.experiments.opening import Open, open_calibration
from pdlab.experiments.readings import is_stale, older_engine
from pdlab.experiments.waiting import Waiting, waiting_of
from pdlab.experiments.ways import AUTO, Way, way_of
from pdlab.experiments.wishes import ask_calibrations
from pdlab.models import Aggregate, Calibration
from pdlab.store import Store

POINTS = 60
"""Coefficients at which a curve is drawn."""


@dataclass(frozen=True)
class CurveNode:
    """A node: its coefficient [-], the ``mean`` and ``deviation`` of its ``runs``, NaN of a single one."""

    value: float
    mean: float
    deviation: float
    runs: tuple[float, ...]


@dataclass(frozen=True)
class DrawnCurve:
    """A curve as far as it is simulated: its nodes, and ``values``, ``means``, ``errors`` on a fine grid, shape (60,).

    ``coefficient``: friction or rolling. ``sought``: packing_density [-] or repose_angle_deg [degrees].
    """

    coefficient: str
    sought: str
    nodes: tuple[CurveNode, ...]
    values: tuple[float, ...]
    means: tuple[float, ...]
    errors: tuple[float, ...]


@dataclass(frozen=True)
class Explained:
    """What is known of an aggregate's calibration; ``measured`` in the unit of what is ``sought``, None without a test.

    ``value``: the coefficient [-] with its interval, ``low`` or ``high`` None where it is open; ``why``: the method.
    ``message``: why there is no calibration; ``notes``: what speaks against it. ``calibration_id``: of the one that is
    explained, done or failed. ``compaction``: of the density test, empty without one or where it is not stated.
    """

    aggregate_id: int
    name: str
    method: str = ""
    why: str = ""
    curve: DrawnCurve | None = None
    measured: float | None = None
    measured_error: float | None = None
    value: float | None = None
    low: float | None = None
    high: float | None = None
    message: str = ""
    notes: tuple[str, ...] = ()
    calibration_id: int | None = None
    compaction: str = ""


def explain(target: Store, aggregate_id: int) -> Explained:
    """Return an aggregate's last calibration with what it rests on, or what there is before one. Raises UnknownName."""
    with target.read() as session:
        row = _aggregate(session, aggregate_id)
        ended = [fit for fit in store.calibrations(session, [aggregate_id]) if not fit.variant]
        newest = store.newest_engine(session)
    fit = ended[0] if ended else None
    known = Explained(row.id, f"{row.name} {row.delivery}".strip(), calibration_id=fit.id if fit is not None else None)
    way = Way() if fit is None else way_of(fit)
    if way.method == AUTO:  # a wish that failed chose none
        way = replace(way, method=MONOSIZED, leave_out=None)
    try:
        opened = open_calibration(row, way)
        curves = Curves(target, (fit.engine_version if fit is not None else newest) or 0)
        ladders = {method: opened.ladder(method) for method in _methods(opened.method)}
        curves.load(ladders.values())
    except InputError as error:
        return replace(known, message=str(error))
    return _explained(
        known, opened, fit, {method: curves.known(one) for method, one in ladders.items()}, curves, newest
    )


def waiting_calibration(target: Store, aggregate_id: int) -> Waiting | None:
    """Return the calibration that an aggregate waits for, the last asked for; None where it waits for none."""
    with target.read() as session:
        row = store.waiting_calibration(session, aggregate_id)
        return None if row is None else waiting_of(session, ("calibration", row.id), row)


def ask_calibration(target: Store, aggregate_id: int, method: str) -> str:
    """Wish for a calibration unless it is there; return why there can be none, empty where nothing stands against it.

    What is there is of the newest engine that the store knows: a runner works with its own. Raises UnknownName.
    """
    with target.read() as session:
        row = _aggregate(session, aggregate_id)
        newest = store.newest_engine(session) or 0
    try:
        asked = ask_calibrations(target, [row], Way(method), newest)
    except PdlabError as error:
        return str(error)
    report = asked.reports.get(row.id)
    return str(report.error) if report is not None and report.error is not None else ""


def _aggregate(session: Session, aggregate_id: int) -> Aggregate:
    row = next(iter(store.aggregates_by_id(session, [aggregate_id])), None)
    if row is None:
        raise UnknownName(f"the store holds no aggregate {aggregate_id}; choose another")
    return row


def _methods(method: str) -> Sequence[str]:
    """Return the methods whose curves say why one was taken."""
    return (REPOSE,) if method == REPOSE else tuple(dict.fromkeys((method, MONOSIZED)))


def _explained(
    known: Explained, opened: Open, fit: Calibration | None, found: dict[str, Curve | None], curves: Curves,
    newest: int | None,
) -> Explained:  # fmt: skip
    ladder, measured = opened.ladder(), opened.measured
    stated = {test.id: test.compaction for test in opened.aggregate.packing_tests if test.compaction != "unstated"}
    result = calibration_report(fit.aggregate, fit).result if fit is not None else None
    notes = list(opened.warnings if fit is None else (fit.warnings or "").splitlines())
    if fit is not None and is_stale(fit):
        notes.append("tested or sieved anew since, or corrected: calibrate again")
    if fit is not None and (older := older_engine(fit.engine_version, newest)):
        notes.append(older)
    return replace(
        known, method=opened.method if fit is not None else "",
        why=_why(opened.method, found.get(MONOSIZED)) if fit is not None else "",
        curve=_drawn(ladder, found[opened.method], curves), measured=measured.value,
        measured_error=measured.standard_error, value=None if result is None else result.value,
        low=None if result is None else result.low, high=None if result is None else result.high,
        message=(fit.message or "") if fit is not None else "", notes=tuple(notes),
        compaction=stated.get(opened.tested.get("packing_test_id", 0), ""),
    )  # fmt: skip


def _why(method: str, equal: Curve | None) -> str:
    """Return why a method was taken; ``equal``: the curve of equal spheres with friction."""
    span = "an interval that is not simulated yet" if equal is None else _span(equal)
    return {
        MONOSIZED: f"equal spheres with friction alone, the simplest method: simulated so far, they span {span}",
        ROLLING: f"equal spheres with friction alone, which span {span}, are not as loose: rolling resistance is added",
        GRADED: f"equal spheres with friction alone, which span {span}, are not as dense: spheres of every sieve class",
        REPOSE: "calibrated to the angle of repose",
    }[method]


def _span(known: Curve) -> str:
    means = known.monotone()
    return f"{means.min():.3f} to {means.max():.3f}"


def _drawn(ladder: Ladder, known: Curve | None, curves: Curves) -> DrawnCurve | None:
    if known is None:
        return None
    column, runs = ladder.sought.column, curves.runs(ladder)
    nodes = tuple(
        CurveNode(
            point.value, point.mean, point.deviation, tuple(float(getattr(run, column)) for run in runs[point.value])
        )
        for point in known.points
    )
    first, last = nodes[0].value, nodes[-1].value
    inside = np.linspace(math.sqrt(first), math.sqrt(last), POINTS)[1:-1] ** 2  # the ends are the nodes, not rounded
    values = [first, *inside.tolist(), last]
    return DrawnCurve(
        "rolling" if ladder.method == ROLLING else "friction",
        "repose_angle_deg" if ladder.sought is ANGLE else calibration.DENSITY.column,
        nodes, tuple(values), tuple(map(known.at, values)), tuple(map(known.error_at, values)),
    )  # fmt: skip
