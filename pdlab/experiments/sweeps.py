"""Sweeps: calibrate aggregates, go over their proportions, keep the curve and the densest mix with its descent."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from pdlab import mixture, store, sweep
from pdlab.errors import InputError, PdlabError, UnknownName
from pdlab.experiments.calibrations import CalibrationReport, calibrating
from pdlab.experiments.predictions import part_of
from pdlab.experiments.readings import an_object, kept, mean_density, measured_test
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.ways import Way, way_kept
from pdlab.models import Aggregate, Mixture, Sweep, SweepCalibration, SweepComponent, SweepRun, now
from pdlab.plan import Plan, RunAll, at_once, finish
from pdlab.specimen import on_grid, protocol_of
from pdlab.store import Claim, Store
from pdlab.sweep import MOST, WISHED_ERROR, Densest, Measurement, NextTest, Point, Swept

DIGITS = 6
"""Decimals of what is kept for drawing."""


@dataclass(frozen=True)
class SweepReport:
    """A sweep of aggregates, or the error that stands in its place; ``notes``: its warnings, what ``auto`` took."""

    aggregates: tuple[str, ...]
    method: str
    rule: str
    result: Swept | None = None
    notes: tuple[str, ...] = ()
    state: str = "done"
    sweep_id: int | None = None
    engine_version: int | None = None
    error: PdlabError | None = None


@dataclass(frozen=True)
class MeasuredMix:
    """A mixture that was tested: its ``shares`` [-] of the aggregates asked about, in their order, its PD [-]."""

    name: str
    shares: tuple[float, ...]
    packing_density: float
    standard_error: float


@dataclass
class _Asked:
    """A sweep on its way: what it is of, how it was asked for, what it rests on."""

    rows: list[Aggregate]
    way: Way
    wished_error: float
    most: int
    engine_version: int
    reports: Sequence[CalibrationReport] = ()
    measured: Sequence[Measurement] = ()
    result: Swept | None = None
    error: PdlabError | None = None

    @property
    def sources(self) -> set[int]:
        """The calibrations that it rests on."""
        return {report.calibration_id for report in self.reports if report.calibration_id is not None}

    def is_kept_by(self, row: Sweep) -> bool:
        """Return whether a stored sweep was worked out from the same, as far as it was asked for in the same way."""
        asked = (self.way.text(), self.wished_error, self.most, self.engine_version)
        if row.state != "done" or asked != (row.asked, row.wished_error, row.most_specimens, row.engine_version):
            return False
        same = {link.calibration_id for link in row.calibrations} == self.sources
        return same and rests_on_measured(row, self.measured)


def sweep_aggregates(
    target: Store,
    run_all: RunAll,
    names: Sequence[str],
    way: Way | None = None,
    wished_error: float = WISHED_ERROR,
    most_specimens: int | None = None,
) -> SweepReport:
    """Sweep the proportions of the named aggregates, calibrating them first; what went wrong stands in the report.

    A sweep of the same calibrations, asked for in the same way, is read and never worked out again, unless a mixture
    of the aggregates was measured since. Raises UnknownName, and InputError for what cannot be swept.
    """
    rows = to_sweep(target, names, way or Way())
    plan = sweeping(target, rows, way or Way(), wished_error, most_specimens, run_all.engine_version)
    return finish(plan, run_all)


def to_sweep(target: Store, names: Sequence[str], way: Way) -> list[Aggregate]:
    """Return the named aggregates. Raises UnknownName, and InputError for a reference and for too few or too many."""
    if way.method in REFERENCES:
        raise InputError(f"'{way.method}' is a geometric reference, of which nothing is swept; use another method")
    sweep.check_aggregates(len(dict.fromkeys(names)))
    with target.read() as session:
        return store.aggregates(session, names)


def sweeping(
    target: Store,
    rows: Sequence[Aggregate],
    way: Way,
    wished_error: float = WISHED_ERROR,
    most_specimens: int | None = None,
    engine_version: int = 0,
    claim: Claim | None = None,
) -> Plan[SweepReport]:
    """Sweep the proportions of aggregates as ``sweep_aggregates`` does, each in the delivery that is handed in.

    ``claim``: the wish in whose row the result is written. Raises InputError, ClaimLost.
    """
    most = MOST.get(len(rows), 0) if most_specimens is None else most_specimens
    sweep.check_aggregates(len(rows))
    sweep.check_wish(wished_error, most)
    asked = _Asked(list(rows), way, wished_error, most, engine_version)
    asked.reports = yield from calibrating(target, rows, way, engine_version)
    equal = _find_equal(target, asked)
    if equal is None:
        yield from _working_out(target, asked)
    return _with_choices(_save(target, asked, equal, claim), asked)


def read_sweep(
    target: Store, rows: Sequence[Aggregate], way: Way, wished_error: float, most: int, engine_version: int
) -> SweepReport | None:
    """Return the sweep of aggregates that is kept, or why there can be none; None where it is yet to be worked out.

    To begin one takes seconds, of its specimens and its surface, for which no page waits.
    """
    reports = at_once(calibrating(target, rows, way, engine_version))
    if reports is None:
        return None
    asked = _Asked(list(rows), way, wished_error, most, engine_version, reports)
    equal = _find_equal(target, asked)
    if equal is None:
        try:
            for report in reports:
                _part(report)
            return None
        except PdlabError as error:
            asked.error = error
    return _with_choices(_save(target, asked, equal, None), asked)


def _find_equal(target: Store, asked: _Asked) -> Sweep | None:
    """Take in what was measured; return a stored sweep that was worked out from the same."""
    with target.read() as session:
        ids = [row.id for row in asked.rows]
        mixes = measured_mixes(session, ids, asked.reports[0].protocol.compaction)
        asked.measured = [Measurement(mix.shares, mix.standard_error) for mix in mixes]
        kept = store.ended_sweeps(session, ids, asked.way.method, asked.way.variant)
    return next((row for row in kept if asked.is_kept_by(row)), None)


def rests_on_measured(row: Sweep, measured: Sequence[Measurement | MeasuredMix]) -> bool:
    """Return whether a stored sweep took in these measured mixtures, and no others."""
    taken = kept(row, "curve", an_object).get("measured") if row.curve else None
    return bool(taken == [list(mix.shares) for mix in measured])


def _working_out(target: Store, asked: _Asked) -> Plan[None]:
    """Sweep, or say why it cannot be done."""
    method_error = _method_error(target, asked)
    try:
        parts = [_part(report) for report in asked.reports]
        asked.result = yield from sweep.sweeping(parts, asked.wished_error, asked.most, asked.measured, method_error)
    except PdlabError as error:
        asked.error = error


def _part(report: CalibrationReport) -> mixture.Part:
    """Return a calibrated aggregate with the PD that its spheres have alone. Raises its error where it has none."""
    if report.result is None:
        text = f"aggregate '{report.aggregate}' is not calibrated: {report.error}"
        raise type(report.error or InputError())(text)
    return replace(part_of(report, 1.0), packing_density=report.result.packing_density)


def measured_mixes(session: Session, aggregate_ids: Sequence[int], compaction: str) -> list[MeasuredMix]:
    """Return the mixtures of these aggregates alone that were tested in a compaction, by the newest such test."""
    places, out = {key: k for k, key in enumerate(aggregate_ids)}, list[MeasuredMix]()
    for blend in store.measured_blends(session, aggregate_ids):
        alike = [test for test in blend.packing_tests if protocol_of(test.compaction).compaction == compaction]
        if (test := store.newest_test(alike)) is not None:
            measured = measured_test(test, mean_density(blend))
            shares = _shares(blend, places)
            out.append(MeasuredMix(blend.name, shares, measured.packing_density, measured.standard_error))
    return out


def _shares(blend: Mixture, places: dict[int, int]) -> tuple[float, ...]:
    """Return a mixture's shares [-] in the order of the sweep's aggregates."""
    shares, total = [0.0] * len(places), math.fsum(part.solid_volume_share for part in blend.components)
    for part in blend.components:
        shares[places[part.aggregate_id]] += part.solid_volume_share / total
    return tuple(on_grid(share) for share in shares)


def _method_error(target: Store, asked: _Asked) -> float:
    """Return the root mean square difference of the method's predictions in PD [-], the default for fewer than two."""
    with target.read() as session:
        count, squares = store.differences(session).get((asked.way.method, asked.engine_version), (0, 0.0))
    return math.sqrt(squares / count) if count >= 2 and squares > 0.0 else sweep.METHOD_ERROR


def _with_choices(report: SweepReport, asked: _Asked) -> SweepReport:
    """Add why ``auto`` took the methods that it took, and the error itself."""
    choices = tuple(f"{one.aggregate}: {one.choice}" for one in asked.reports if one.choice)
    return replace(report, notes=(*choices, *report.notes), error=asked.error)


def _save(target: Store, asked: _Asked, equal: Sweep | None, claim: Claim | None) -> SweepReport:
    """Write a sweep, or why there is none; of an equal one only the time is renewed."""
    with target.write() as session:
        row = None if equal is None else store.find_row(session, Sweep, equal.id)
        if claim is not None:
            wish = store.claimed(session, Sweep, claim)
            _fill(wish, _facts(asked) if row is None else _answer(row), asked if row is None else row)
            row = wish
        elif row is None:
            row = _same_failure(session, asked) or _new(session, asked)
        row.progress, row.finished_at = 1.0, row.finished_at or now()
        row.requested_at = now()
        session.flush()
        key = row.id
    return report_of(target, key)


def _new(session: Session, asked: _Asked) -> Sweep:
    row = Sweep(
        method=asked.way.method, variant=asked.way.variant, asked=asked.way.text(), wished_error=asked.wished_error,
        most_specimens=asked.most,
        components=[SweepComponent(position=k, aggregate_id=one.id) for k, one in enumerate(asked.rows)],
    )  # fmt: skip
    _fill(row, _facts(asked), asked)
    store.add_all(session, [row])
    return row


def _same_failure(session: Session, asked: _Asked) -> Sweep | None:
    """Return the sweep that failed before for the same reason."""
    if asked.error is None:
        return None
    rows = store.ended_sweeps(session, [row.id for row in asked.rows], asked.way.method, asked.way.variant)
    facts = (str(asked.error), asked.way.text(), asked.wished_error, asked.most, asked.engine_version)
    same = [
        row for row in rows
        if facts == (row.message, row.asked, row.wished_error, row.most_specimens, row.engine_version)
    ]  # fmt: skip
    return next((row for row in same if {link.calibration_id for link in row.calibrations} == asked.sources), None)


ANSWER = (
    "engine_version", "packing_density", "standard_error", "input_error", "curve", "warnings", "state", "message",
)  # fmt: skip
"""The columns of a sweep that say what came out."""


def _facts(asked: _Asked) -> dict[str, Any]:
    """Return the columns that say what came out."""
    facts = dict.fromkeys(ANSWER) | {"engine_version": asked.engine_version}
    if asked.result is None:
        return facts | {"state": "failed", "message": str(asked.error)}
    best = asked.result.densest
    return facts | {
        "state": "done",
        "packing_density": best.packing_density,
        "standard_error": best.standard_error,
        "input_error": best.input_error,
        "curve": _curve_text(asked.result, asked.measured),
        "warnings": "\n".join(asked.result.warnings) or None,
    }


def _answer(row: Sweep) -> dict[str, Any]:
    return {name: getattr(row, name) for name in ANSWER}


def _fill(row: Sweep, facts: dict[str, Any], source: "_Asked | Sweep") -> None:
    """Write what came out into a row, and what it rests on."""
    for name, value in facts.items():
        setattr(row, name, value)
    if isinstance(source, Sweep):
        digests, sources = {link.specimen_hash for link in source.runs}, {x.calibration_id for x in source.calibrations}
        shares = [(part.densest_share, part.next_share) for part in source.components]
    else:
        result, sources = source.result, source.sources
        digests = set() if result is None else {point.digest for point in result.points}
        test = None if result is None else result.next_test
        best = [None] * len(source.rows) if result is None else list(result.densest.shares)
        shares = list(zip(best, [None] * len(best) if test is None else test.shares, strict=True))
    row.runs = [SweepRun(specimen_hash=digest) for digest in sorted(digests)]
    row.calibrations = [SweepCalibration(calibration_id=key) for key in sorted(sources)]
    for part, (densest, following) in zip(row.components, shares, strict=True):
        part.densest_share, part.next_share = densest, following


def _curve_text(result: Swept, measured: Sequence[Measurement]) -> str:
    """Return what is drawn of a sweep as JSON: places with PD and deviation, points, the densest mix, the next test."""
    test = result.next_test
    return json.dumps(
        {
            "shares": np.round(result.shares, DIGITS).tolist(),
            "packing_density": np.round(result.packing_density, DIGITS).tolist(),
            "deviation": np.round(result.deviation, DIGITS).tolist(),
            "points": [asdict(point) for point in result.points],
            "densest": asdict(result.densest),
            "next_test": None if test is None else asdict(test),
            "measured": [mix.shares for mix in measured],
        }
    )


def result_of(row: Sweep) -> Swept:
    """Return what a stored sweep gave."""
    return kept(row, "curve", partial(_swept, row))


def _swept(row: Sweep, kept: dict[str, Any]) -> Swept:
    """Return what a sweep gave from the plain data that are kept of it."""
    test = kept["next_test"]
    return Swept(
        aggregates=tuple(part.aggregate.name for part in row.components),
        points=tuple(Point(**_tuples(point)) for point in kept["points"]),
        shares=np.array(kept["shares"]),
        packing_density=np.array(kept["packing_density"]),
        deviation=np.array(kept["deviation"]),
        densest=Densest(**_tuples(kept["densest"])),
        next_test=None if test is None else NextTest(**_tuples(test)),
        warnings=tuple((row.warnings or "").splitlines()),
    )


def _tuples(facts: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in facts.items()}


def report_of(target: Store, sweep_id: int) -> SweepReport:
    """Return a stored sweep as the report it gave. Raises UnknownName."""
    with target.read() as session:
        row = next(iter(store.sweeps_by_id(session, [sweep_id])), None)
    if row is None:
        raise UnknownName(f"the store holds no sweep {sweep_id}; it was deleted: ask again")
    result = result_of(row) if row.state == "done" else None
    return SweepReport(
        aggregates=tuple(part.aggregate.name for part in row.components),
        method=row.method,
        rule=way_kept(row).rule if row.asked else "",
        result=result,
        notes=tuple(text for text in (row.message, *(row.warnings or "").splitlines()) if text),
        state=row.state,
        sweep_id=row.id,
        engine_version=row.engine_version,
    )
