"""What is said of a prediction: its packing density with its errors, beside the measured one and what theory makes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pdlab import store
from pdlab.calibration import METHOD, REPOSE
from pdlab.errors import PdlabError
from pdlab.experiments import references
from pdlab.experiments.readings import measured_mixture, protocol_kept
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.theories import Theoretical
from pdlab.models import Prediction
from pdlab.store import Store


@dataclass(frozen=True)
class PredictionReport:
    """A mixture's prediction beside its measurement, or the error that stands in its place.

    ``furnas``, ``toufar``, ``cpm``: what theory makes of the current tests, and why not in ``theory_message``.
    ``tested_otherwise``: that the mixture was tested in another compaction, so that the difference is not the method's.
    ``outdated``: those of the ``notes`` that say why it is not what would be now.
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
    tested_otherwise: str = ""
    outdated: tuple[str, ...] = ()
    prediction_id: int | None = None
    engine_version: int | None = None
    error: PdlabError | None = None

    @property
    def message(self) -> str:
        """What there is to say of it: why there is none, its warnings, what changed since, an unlike measurement."""
        return "; ".join(text for text in (*self.notes, self.tested_otherwise) if text)

    @property
    def difference(self) -> float | None:
        """Predicted minus measured packing density."""
        if self.packing_density is None or self.measured is None:
            return None
        return self.packing_density - self.measured


def reports_of(target: Store, ids: Sequence[int]) -> dict[int, PredictionReport]:
    """Return the reports of predictions that are new, by id."""
    with target.read() as session:
        rows = store.predictions_by_id(session, ids)
        spread = store.differences(session)
    return {
        row.id: with_expected_error(report_of(row, []), *spread.get((row.method, row.engine_version), (0, 0.0)))
        for row in rows
    }


def report_of(row: Prediction, outdated: Sequence[str]) -> PredictionReport:
    """Return a stored prediction beside its mixture's measurement; ``outdated``: why it is not what would be now."""
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
        tested_otherwise=_tested_otherwise(row),
        outdated=tuple(outdated),
        prediction_id=row.id,
        engine_version=row.engine_version,
    )


def with_theory(report: PredictionReport, beside: Theoretical) -> PredictionReport:
    """Set a mixture's packing densities by theory beside its prediction, and say which are missing and why."""
    said = dict[str, list[str]]()
    for name, error in beside.errors.items():
        said.setdefault(str(error), []).append(name)
    text = "; ".join(f"no {', '.join(names)}: {error}" for error, names in said.items())
    values = beside.values
    return replace(
        report, furnas=values.get("furnas"), toufar=values.get("toufar"), cpm=values.get("cpm"), theory_message=text
    )


def _tested_otherwise(row: Prediction) -> str:
    """Return what to say where a mixture's density test is of another compaction than its beds; empty where not.

    A geometric reference has no compaction; an unstated one is taken for that of the aggregates' tests, where it was
    these that were calibrated to.
    """
    test = store.newest_test(row.mixture.packing_tests)
    if row.state != "done" or row.method in REFERENCES or test is None:
        return ""
    simulated = protocol_kept(row).compaction
    if test.compaction == simulated or (test.compaction == "unstated" and row.method != REPOSE):
        return ""
    return f"the mixture's density test is {test.compaction}, its beds are {simulated}: the difference is of both"


def _volume_mean(row: Prediction) -> float | None:
    """Return Σ y_i PD_i [-], the mixture's PD if no part filled another's voids; None where one is unknown."""
    alone = {link.calibration.aggregate_id: link.calibration.measured_packing_density for link in row.calibrations}
    parts = [(part.solid_volume_share, alone.get(part.aggregate_id)) for part in row.mixture.components]
    if any(value is None for _, value in parts):
        return None
    return math.fsum(share * (value or 0.0) for share, value in parts) / math.fsum(share for share, _ in parts)


def with_expected_error(report: PredictionReport, count: int, squares: float) -> PredictionReport:
    """Add the simulation's error, the inputs' and, from two other comparisons on, their RMS difference.

    ``count``: the comparisons of its method and engine with mixtures tested as their beds are; ``squares``: the sum of
    their squared differences [-].
    """
    if report.packing_density is None:
        return report
    others, rest = count, squares
    if report.difference is not None and not report.tested_otherwise:
        others, rest = count - 1, squares - report.difference**2
    own = math.sqrt(max(rest, 0.0) / others) if others >= 2 else 0.0  # below 0 by rounding only
    return replace(report, expected_error=math.hypot(report.standard_error or 0.0, report.input_error or 0.0, own))
