"""Predict mixtures from calibrated aggregates, and set predictions beside measurements."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pdlab import grading, mixture, store
from pdlab.calibration import METHOD
from pdlab.errors import InputError, PdlabError, ProtocolError, TooSoft
from pdlab.experiments import references
from pdlab.experiments.calibrations import CalibrationReport, calibrate_rows, calibration_report
from pdlab.experiments.curves import RunAll
from pdlab.experiments.readings import is_stale, measured_mixture, older_engine, protocol_text
from pdlab.experiments.references import ORDERED, REFERENCES
from pdlab.experiments.theories import Theoretical, components_of, evaluate, recipes
from pdlab.experiments.ways import Way
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Aggregate, Mixture, Prediction, PredictionCalibration, PredictionRun, now
from pdlab.specimen import Packing, Protocol, Specimen
from pdlab.store import Store


@dataclass(frozen=True)
class PredictionReport:
    """A mixture's prediction beside its measurement, or the error that stands in its place.

    ``furnas``, ``toufar``, ``cpm``: what theory makes of the current tests, and why not in ``theory_message``.
    """

    mixture: str
    method: str = METHOD
    rule: str = ""
    leave_out: float | None = None
    packing_density: float | None = None
    standard_error: float | None = None
    input_error: float | None = None
    expected_error: float | None = None
    measured: float | None = None
    measured_error: float | None = None
    volume_mean: float | None = None
    furnas: float | None = None
    toufar: float | None = None
    cpm: float | None = None
    theory_message: str = ""
    seeds: int | None = None
    state: str = "done"
    notes: tuple[str, ...] = ()
    prediction_id: int | None = None
    engine_version: int | None = None
    error: PdlabError | None = None

    @property
    def message(self) -> str:
        """What there is to say of it: why there is none, its warnings, what changed since."""
        return "; ".join(self.notes)

    @property
    def difference(self) -> float | None:
        """Predicted minus measured packing density."""
        if self.packing_density is None or self.measured is None:
            return None
        return self.packing_density - self.measured


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


def predict(
    target: Store, run_all: RunAll, names: Sequence[str] = (), way: Way | None = None
) -> list[PredictionReport]:
    """Predict the named mixtures, or all, calibrating their aggregates first where the method does.

    The way's ``seeds``: beds at each node of the curve, and of each mixture at first. Each mixture's error stands in
    its report. Raises UnknownName.
    """
    way = way or Way()
    with target.read() as session:
        rows = store.mixtures(session, names)
    if not rows:
        raise InputError("the store holds no mixture yet; import some, or run 'pdlab demo'")
    with target.read() as session:
        parts = store.aggregates_by_id(session, components_of(rows))
    if way.method in REFERENCES:
        blends = [_open_reference(row, {one.id: one for one in parts}, way) for row in rows]
    else:
        known = {report.aggregate_id: report for report in calibrate_rows(target, run_all, parts, way)}
        blends = [_open_blend(row, known) for row in rows]
    if way.method != ORDERED:
        _run_blends(blends, run_all, way.seeds)
    saved = [_save_prediction(target, blend, way) for blend in blends]
    fresh = _reports(target, saved)
    reports = [
        fresh[key]
        if blend.error is None
        else PredictionReport(blend.row.name, way.method, state="failed", notes=(str(blend.error),), error=blend.error)
        for key, blend in zip(saved, blends, strict=True)
    ]
    beside = evaluate(recipes(rows, parts, way.rule))
    return [_with_theory(report, one) for report, one in zip(reports, beside, strict=True)]


def _open_blend(row: Mixture, known: dict[int, CalibrationReport]) -> _Blend:
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
        parts.append(_part(report, component.solid_volume_share / total))
    test = store.newest_test(row.packing_tests)
    by_angle = any(known[component.aggregate_id].angle is not None for component in row.components)
    if by_angle and test is not None and test.compaction != "vibrated":
        notes.append(f"the mixture's density test is {test.compaction}, what is calibrated to an angle is vibrated")
    return _Blend(row, parts, ids, notes)


def _open_reference(row: Mixture, aggregates: Mapping[int, Aggregate], way: Way) -> _Blend:
    try:
        parts = references.parts_of(row, aggregates, way.method, way.rule, way.pan_factor)
    except PdlabError as error:
        return _Blend(row, [], [], error=error)
    its = [aggregates[part.aggregate_id] for part in row.components]
    return _Blend(row, parts, [], references.notes_of(way.method, its, way.pan_factor))


def _part(report: CalibrationReport, share: float) -> mixture.Part:
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


def _run_blends(blends: list[_Blend], run_all: RunAll, seeds: int) -> None:
    """Run all mixtures' beds round by round, more seeds where the error asks for them."""
    while True:
        wanted: list[tuple[_Blend, Specimen]] = []
        for blend in blends:
            try:
                if blend.error is None:
                    beds = mixture.next_specimens(blend.parts, blend.done, seeds, stiffer=blend.stiffer)
                    wanted += [(blend, bed) for bed in beds]
            except PdlabError as error:
                blend.error = error
        if not wanted:
            return
        outcomes = run_all([bed for _, bed in wanted])
        for (blend, _), outcome in zip(wanted, outcomes, strict=True):
            if isinstance(outcome, Packing):
                blend.done.append(outcome)
            elif blend.error is None or isinstance(blend.error, TooSoft):
                blend.error = outcome
        for blend in blends:
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


def _save_prediction(target: Store, blend: _Blend, way: Way) -> int:
    """Write a prediction, or why there is none; of an equal one on the same runs only the time is renewed."""
    digests, sources = {packing.digest for packing in blend.done}, set(blend.calibration_ids)
    protocol = protocol_text(mixture.stiffened(_protocol_of(blend), blend.stiffer))
    facts: dict[str, Any] = _facts_of(blend, way.method) | {
        "mixture_id": blend.row.id,
        "method": way.method,
        "variant": way.variant,
        "protocol": references.made_by(way.method, way.rule, blend.parts) if way.method in REFERENCES else protocol,
        "engine_version": blend.done[0].engine_version if blend.done else None,
    }
    with target.write() as session:
        old = store.equal_results(session, Prediction, facts, digests)
        row = next((row for row in old if {link.calibration_id for link in row.calibrations} == sources), None)
        if row is None:
            row = Prediction(
                progress=1.0,
                finished_at=now(),
                runs=[PredictionRun(specimen_hash=digest) for digest in sorted(digests)],
                calibrations=[PredictionCalibration(calibration_id=source) for source in sorted(sources)],
                **facts,
            )
            store.add_all(session, [row])
        row.requested_at = now()
        return row.id


def _reports(target: Store, ids: Sequence[int]) -> dict[int, PredictionReport]:
    """Return the reports of predictions that are new, by id."""
    with target.read() as session:
        rows = store.predictions_by_id(session, ids)
        spread = store.differences(session)
    return {
        row.id: _with_expected_error(_comparison(row, []), *spread.get((row.method, row.engine_version), (0, 0.0)))
        for row in rows
    }


def comparisons(
    target: Store, engine_version: int | None = None, names: Sequence[str] = (), newest: int | None = None
) -> list[PredictionReport]:
    """Return each mixture's last prediction by each method beside its current measurement, oldest mixture first.

    All mixtures, the named, or so many of the ``newest``; variants are left out. A mixture without a prediction
    has the state ``open``; ``outdated`` is a prediction of other proportions, tests or sieves than the store's, or
    of an older engine than ``engine_version``, by default the newest there. Raises UnknownName.
    """
    with target.read() as session:
        rows = store.mixtures(session, names, newest)
        newest_engine = engine_version or store.newest_engine(session)
        found = store.newest_predictions(session, [row.id for row in rows])
        spread = store.differences(session)
        parts = store.aggregates_by_id(session, components_of(rows))
    predicted = [one for several in found.values() for one in several]
    fits = {link.calibration_id: link.calibration for one in predicted for link in one.calibrations}
    stale = {key for key, fit in fits.items() if is_stale(fit)}
    known = {one.id: one for one in parts}
    reports = [
        report
        for row in rows
        for report in [_comparison(one, _outdated(one, stale, known, newest_engine)) for one in found.get(row.id, [])]
        or [_open_comparison(row)]
    ]
    beside = {rule: _by_mixture(rows, parts, rule) for rule in {_one_rule(report) for report in reports}}
    return [
        _with_theory(
            _with_expected_error(report, *spread.get((report.method, report.engine_version), (0, 0.0))),
            beside[_one_rule(report)][report.mixture],
        )
        for report in reports
    ]


def _by_mixture(rows: Sequence[Mixture], parts: Sequence[Aggregate], rule: str) -> dict[str, Theoretical]:
    """Return what theory makes of mixtures, by name."""
    return {one.mixture: one for one in evaluate(recipes(rows, parts, rule))}


def _one_rule(report: PredictionReport) -> str:
    """Return the diameter rule of a report, the default where there is none or several."""
    return report.rule if report.rule in grading.RULES else DEFAULT_RULE


def _with_theory(report: PredictionReport, beside: Theoretical) -> PredictionReport:
    """Set a mixture's packing densities by theory beside its prediction, and say which are missing and why."""
    said = dict[str, list[str]]()
    for name, error in beside.errors.items():
        said.setdefault(str(error), []).append(name)
    text = "; ".join(f"no {', '.join(names)}: {error}" for error, names in said.items())
    values = beside.values
    return replace(
        report, furnas=values.get("furnas"), toufar=values.get("toufar"), cpm=values.get("cpm"), theory_message=text
    )


def _open_comparison(row: Mixture) -> PredictionReport:
    measured = measured_mixture(row)
    return PredictionReport(
        mixture=row.name,
        measured=measured.packing_density if measured else None,
        measured_error=measured.standard_error if measured else None,
        state="open",
        notes=("not predicted yet: run 'pdlab predict'",),
    )


def _comparison(row: Prediction, outdated: Sequence[str]) -> PredictionReport:
    measured = measured_mixture(row.mixture)
    notes = [row.message or "", *(row.warnings or "").splitlines(), *outdated]
    rules = {link.calibration.diameter_rule for link in row.calibrations}
    return PredictionReport(
        mixture=row.mixture.name,
        method=row.method,
        rule=references.rule_of(row) if row.method in REFERENCES else ", ".join(sorted(rules)),
        leave_out=max((link.calibration.leave_out_below_mm or 0.0 for link in row.calibrations), default=0.0) or None,
        packing_density=row.packing_density,
        standard_error=row.standard_error,
        input_error=row.input_error,
        measured=measured.packing_density if measured else None,
        measured_error=measured.standard_error if measured else None,
        volume_mean=_volume_mean(row) if row.state == "done" else None,
        seeds=len(row.runs),
        state="outdated" if outdated and row.state == "done" else row.state,
        notes=tuple(note for note in notes if note),
        prediction_id=row.id,
        engine_version=row.engine_version,
    )


def _outdated(
    row: Prediction, stale: Collection[int], aggregates: Mapping[int, Aggregate], newest_engine: int | None
) -> list[str]:
    """Return why a prediction is not what the store would give now, and what to do; empty where it is.

    ``stale``: the ids of calibrations that are not; ``aggregates``: by id, with their sieve analyses.
    """
    out = []
    names = [link.calibration.aggregate.name for link in row.calibrations if link.calibration_id in stale]
    older = older_engine(row.engine_version, newest_engine)
    if names:
        out.append(f"{', '.join(names)}: tested or sieved anew since, or corrected; run 'pdlab predict' again")
    if older:
        out.append(older)
    # an older engine's beds, or those of other diameters, say nothing of the proportions
    if out or row.state != "done":
        return out
    if row.method in REFERENCES:
        if not references.is_current(row, aggregates):
            out.append("the mixture's sieves or shares are others since; run 'pdlab predict' again")
    elif not _rests_on_these_proportions(row):
        out.append("the mixture was corrected since; run 'pdlab predict' again")
    return out


def _rests_on_these_proportions(row: Prediction) -> bool:
    """Return whether the bed that the mixture's shares ask for now is among the prediction's runs."""
    fits = [link.calibration for link in row.calibrations]
    known = {fit.aggregate_id: calibration_report(fit.aggregate, fit) for fit in fits}
    if known.keys() != {part.aggregate_id for part in row.mixture.components}:
        return False
    parts = _open_blend(row.mixture, known).parts
    try:
        stiffer = mixture.common_protocol(parts).nominal_overlap / json.loads(row.protocol)["nominal_overlap"]
        bed = mixture.next_specimens(parts, [], stiffer=stiffer)[0]
    except PdlabError:  # what the rows say now cannot be simulated at all
        return False
    return bed.digest(row.engine_version or 0) in {run.specimen_hash for run in row.runs}


def _volume_mean(row: Prediction) -> float | None:
    """Return Σ y_i PD_i [-], the mixture's PD if no part filled another's voids; None where one is unknown."""
    alone = {link.calibration.aggregate_id: link.calibration.measured_packing_density for link in row.calibrations}
    parts = [(part.solid_volume_share, alone.get(part.aggregate_id)) for part in row.mixture.components]
    if any(value is None for _, value in parts):
        return None
    return math.fsum(share * (value or 0.0) for share, value in parts) / math.fsum(share for share, _ in parts)


def _with_expected_error(report: PredictionReport, count: int, squares: float) -> PredictionReport:
    """Add the simulation's error, the inputs' and, from two other comparisons on, their RMS difference.

    ``count``: the comparisons of its method and engine; ``squares``: the sum of their squared differences [-].
    """
    if report.packing_density is None:
        return report
    others, rest = count, squares
    if report.difference is not None:
        others, rest = count - 1, squares - report.difference**2
    own = math.sqrt(max(rest, 0.0) / others) if others >= 2 else 0.0  # below 0 by rounding only
    return replace(report, expected_error=math.hypot(report.standard_error or 0.0, report.input_error or 0.0, own))
