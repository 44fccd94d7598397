"""Predict mixtures from calibrated aggregates; what is kept of the same calibrations and beds is read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pdlab import mixture, store
from pdlab.errors import InputError, PdlabError, ProtocolError, TooSoft
from pdlab.experiments import references
from pdlab.experiments.calibrations import CalibrationReport, calibrating
from pdlab.experiments.readings import kept, protocol_text
from pdlab.experiments.references import ORDERED, REFERENCES
from pdlab.experiments.reports import PredictionReport, reports_of, with_theory
from pdlab.experiments.theories import components_of, evaluate, recipes
from pdlab.experiments.ways import Way
from pdlab.models import Aggregate, Mixture, Prediction, PredictionCalibration, PredictionRun, now
from pdlab.plan import Plan, RunAll, at_once, finish, together
from pdlab.specimen import Packing, Protocol
from pdlab.store import Claim, Store

ANSWER = (
    "protocol", "engine_version", "packing_density", "standard_error", "input_error", "warnings", "state", "message",
)  # fmt: skip
"""The columns of a prediction that say how it was worked out and what came out."""


@dataclass
class _Blend:
    """A mixture on its way to a prediction; ``notes``: what ``auto`` took, what a reference is, other doubts."""

    row: Mixture
    parts: list[mixture.Part]
    calibration_ids: list[int]
    notes: list[str] = field(default_factory=list)
    done: list[Packing] = field(default_factory=list)
    error: PdlabError | None = None
    stiffer: float = 1.0
    kept: Prediction | None = None


def predict(
    target: Store, run_all: RunAll, names: Sequence[str] = (), way: Way | None = None
) -> list[PredictionReport]:
    """Predict the named mixtures, or all, calibrating their aggregates first where the method does.

    The way's ``seeds``: beds at each node of the curve, and of each mixture at first. Each mixture's error stands in
    its report. Raises UnknownName.
    """
    way = way or Way()
    return finish(predicting(target, to_predict(target, names), way, run_all.engine_version), run_all)


def to_predict(target: Store, names: Sequence[str]) -> list[Mixture]:
    """Return the named mixtures, or all. Raises UnknownName, and InputError for none."""
    with target.read() as session:
        rows = store.mixtures(session, names)
    if not rows:
        raise InputError("the store holds no mixture yet; import some, or run 'pdlab demo'")
    return rows


def predicting(
    target: Store, rows: Sequence[Mixture], way: Way, engine_version: int, claim: Claim | None = None
) -> Plan[list[PredictionReport]]:
    """Predict mixtures as ``predict`` does; what is kept of the same calibrations and beds is read.

    ``claim``: the wish of one mixture, in whose row the result is written. Raises ClaimLost.
    """
    with target.read() as session:
        parts = store.aggregates_by_id(session, components_of(rows))
    if way.method in REFERENCES:
        blends = [_open_reference(row, {one.id: one for one in parts}, way) for row in rows]
    else:
        reports = yield from calibrating(target, parts, way, engine_version)
        known = {report.aggregate_id: report for report in reports}
        blends = [open_blend(row, known) for row in rows]
    _find_kept(target, blends, way, engine_version)
    if way.method != ORDERED:
        yield from together([_running(blend, way.seeds) for blend in blends if blend.kept is None])
    saved = [_save(target, blend, way, claim) for blend in blends]
    fresh = reports_of(target, saved)
    beside = evaluate(recipes(rows, parts, way.rule))
    return [
        with_theory(_or_failed(fresh[key], blend, way), one)
        for key, blend, one in zip(saved, blends, beside, strict=True)
    ]


def _or_failed(report: PredictionReport, blend: _Blend, way: Way) -> PredictionReport:
    """Return the report, or where there is no prediction its error."""
    if blend.error is None:
        return report
    return PredictionReport(
        blend.row.name, way.method, state="failed", notes=(str(blend.error),), prediction_id=report.prediction_id,
        error=blend.error,
    )  # fmt: skip


def answered(target: Store, rows: Sequence[Mixture], way: Way, engine_version: int) -> dict[int, PredictionReport]:
    """Return, by the mixture's id, the predictions that the store holds already, by the way asked for."""
    with target.read() as session:
        parts = store.aggregates_by_id(session, components_of(rows))
    if way.method in REFERENCES:
        blends = [_open_reference(row, {one.id: one for one in parts}, way) for row in rows]
    else:
        known = dict[int, CalibrationReport]()
        for part in parts:
            for report in at_once(calibrating(target, [part], way, engine_version)) or ():
                known[report.aggregate_id] = report
        able = [row for row in rows if all(part.aggregate_id in known for part in row.components)]
        blends = [open_blend(row, known) for row in able]
    _find_kept(target, blends, way, engine_version)
    kept = [blend for blend in blends if blend.kept is not None]
    keys = [blend.kept.id for blend in kept if blend.kept is not None]
    _renew(target, keys)
    found, beside = reports_of(target, keys), evaluate(recipes([blend.row for blend in kept], parts, way.rule))
    return {
        blend.row.id: with_theory(found[key], theory) for blend, key, theory in zip(kept, keys, beside, strict=True)
    }


def _renew(target: Store, keys: Sequence[int]) -> None:
    """Make predictions that are asked for again the newest of their mixtures and methods, where they are not."""
    with target.read() as session:
        older = store.not_newest(session, keys)
    if older:
        with target.write() as session:
            for key in older:
                row = store.find_row(session, Prediction, key)
                if row is not None:
                    row.requested_at = now()


def _find_kept(target: Store, blends: Sequence[_Blend], way: Way, engine_version: int) -> None:
    """Take what the store holds of predictions that rest on the same calibrations and on the beds asked for first."""
    with target.read() as session:
        rows = store.done_predictions(session, [one.row.id for one in blends], way.method, way.variant, engine_version)
    for blend in blends:
        if blend.error is None:
            blend.kept = next((row for row in rows.get(blend.row.id, ()) if _is_kept_by(blend, row, way)), None)


def _is_kept_by(blend: _Blend, row: Prediction, way: Way) -> bool:
    if len(row.runs) < way.seeds or {link.calibration_id for link in row.calibrations} != set(blend.calibration_ids):
        return False
    if way.method in REFERENCES:
        same = references.made_by(way.method, way.rule, blend.parts) == row.protocol
        if way.method == ORDERED or not same:
            return same
    try:
        bed = mixture.next_specimens(blend.parts, [], stiffer=stiffer_than(blend.parts, row))[0]
    except PdlabError:
        return False
    return bed.digest(row.engine_version or 0) in {link.specimen_hash for link in row.runs}


def stiffer_than(parts: Sequence[mixture.Part], row: Prediction) -> float:
    """Return how many times as stiff as in the calibrations the contacts of a prediction's beds are."""
    overlap = kept(row, "protocol", lambda value: float(value.get("nominal_overlap", math.nan)))
    usual = mixture.common_protocol(parts).nominal_overlap
    return 1.0 if math.isnan(overlap) else usual / overlap


def open_blend(row: Mixture, known: Mapping[int, CalibrationReport]) -> _Blend:
    """Return a mixture on its way to a prediction, from the calibrations of its aggregates by id."""
    parts, ids, notes = [], [], []
    total = math.fsum(component.solid_volume_share for component in row.components)  # 1 but for rounding
    for component in row.components:
        report = known[component.aggregate_id]
        if report.result is None or report.calibration_id is None:
            text = f"aggregate '{report.aggregate}' of mixture '{row.name}' is not calibrated: {report.error}"
            return _Blend(row, [], [], error=type(report.error or InputError())(text))
        ids.append(report.calibration_id)
        if report.choice:
            notes.append(f"{report.aggregate}: {report.choice}")
        parts.append(part_of(report, component.solid_volume_share / total))
    return _Blend(row, parts, ids, notes)


def _open_reference(row: Mixture, aggregates: Mapping[int, Aggregate], way: Way) -> _Blend:
    try:
        parts = references.parts_of(row, aggregates, way.method, way.rule, way.pan_factor)
    except PdlabError as error:
        return _Blend(row, [], [], error=error)
    its = [aggregates[part.aggregate_id] for part in row.components]
    return _Blend(row, parts, [], references.notes_of(way.method, its, way.pan_factor))


def part_of(report: CalibrationReport, share: float) -> mixture.Part:
    """Return a calibrated aggregate as a mixture's part with this share of the solid volume [-]."""
    assert report.result is not None
    return mixture.Part(
        aggregate=report.aggregate,
        share=share,
        sizes=report.sizes,
        friction=report.friction,
        packing_density=report.packing_density,
        input_error=report.result.input_error,
        curve_error=report.result.curve_error,
        protocol=report.protocol,
        density=report.density,
        rolling=report.rolling,
    )


def _running(blend: _Blend, seeds: int) -> Plan[None]:
    """Run a mixture's beds, more seeds where the error asks for them, stiffer ones where they are too soft."""
    while blend.error is None:
        try:
            beds = mixture.next_specimens(blend.parts, blend.done, seeds, stiffer=blend.stiffer)
        except PdlabError as error:
            blend.error = error
            return
        if not beds:
            return
        for outcome in (yield beds):
            if isinstance(outcome, Packing):
                blend.done.append(outcome)
            elif blend.error is None or isinstance(blend.error, TooSoft):
                blend.error = outcome
        if isinstance(blend.error, TooSoft) and blend.stiffer < mixture.STIFFEST:
            blend.stiffer, blend.done, blend.error = blend.stiffer * mixture.STIFFER, [], None


def _facts_of(blend: _Blend, method: str) -> dict[str, Any]:
    if blend.error is not None:
        return {"state": "failed", "message": str(blend.error)}
    if method in REFERENCES:
        result = references.result_of(method, blend.parts, blend.done)
    else:
        result = mixture.predict(blend.parts, blend.done, blend.stiffer)
    return {
        "state": "done",
        "message": None,
        "packing_density": result.packing_density,
        "standard_error": result.standard_error,
        "input_error": result.input_error,
        "warnings": "\n".join([*blend.notes, *result.warnings]) or None,
    }


def _protocol_of(blend: _Blend) -> Protocol:
    """Return the protocol of a mixture's beds; the first part's where it failed since they have none in common."""
    try:
        return mixture.common_protocol(blend.parts)
    except ProtocolError:
        return blend.parts[0].protocol


def _save(target: Store, blend: _Blend, way: Way, claim: Claim | None) -> int:
    """Write a prediction, or why there is none; of an equal one on the same runs only the time is renewed."""
    digests, sources = {packing.digest for packing in blend.done}, set(blend.calibration_ids)
    with target.write() as session:
        row = None if blend.kept is None else store.find_row(session, Prediction, blend.kept.id)
        facts = _row_facts(blend, way) if row is None else {}
        if row is None:
            old = store.equal_results(session, Prediction, facts, digests)
            row = next((row for row in old if {link.calibration_id for link in row.calibrations} == sources), None)
        if claim is not None:
            row = _answered(store.claimed(session, Prediction, claim), row, facts, digests, sources)
        elif row is None:
            row = _linked(Prediction(**facts), digests, sources)
            store.add_all(session, [row])
        row.progress, row.finished_at = 1.0, row.finished_at or now()
        row.requested_at = now()
        session.flush()
        return row.id


def _row_facts(blend: _Blend, way: Way) -> dict[str, Any]:
    """Return a prediction's row but for what it rests on: what was asked and what came out."""
    protocol = protocol_text(mixture.stiffened(_protocol_of(blend), blend.stiffer))
    return _facts_of(blend, way.method) | {
        "mixture_id": blend.row.id,
        "method": way.method,
        "variant": way.variant,
        "protocol": references.made_by(way.method, way.rule, blend.parts) if way.method in REFERENCES else protocol,
        "engine_version": blend.done[0].engine_version if blend.done else None,
    }


def _answered(
    wish: Prediction, equal: Prediction | None, facts: dict[str, Any], digests: set[str], sources: set[int]
) -> Prediction:
    """Write the result into the row of the wish, as it stands in an equal row if there is one."""
    if equal is not None and equal is not wish:
        facts = {name: getattr(equal, name) for name in ANSWER}
        digests = {link.specimen_hash for link in equal.runs}
    for name, value in facts.items():
        setattr(wish, name, value)
    return _linked(wish, digests, sources)


def _linked(row: Prediction, digests: set[str], sources: set[int]) -> Prediction:
    """Set what a prediction rests on."""
    row.runs = [PredictionRun(specimen_hash=digest) for digest in sorted(digests)]
    row.calibrations = [PredictionCalibration(calibration_id=source) for source in sorted(sources)]
    return row
