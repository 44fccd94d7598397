"""Each mixture's last predictions beside its measurement, and which of them are outdated."""

from collections.abc import Collection, Mapping, Sequence

from pdlab import grading, mixture, store
from pdlab.errors import PdlabError
from pdlab.experiments import references
from pdlab.experiments.calibrations import calibration_report
from pdlab.experiments.predictions import open_blend, stiffer_than
from pdlab.experiments.readings import is_stale, measured_mixture, older_engine
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.reports import PredictionReport, report_of, with_expected_error, with_theory
from pdlab.experiments.theories import Theoretical, components_of, evaluate, recipes
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Aggregate, Mixture, Prediction
from pdlab.store import Store


def comparisons(target: Store, engine_version: int | None = None, names: Sequence[str] = ()) -> list[PredictionReport]:
    """Return each mixture's last prediction by each method beside its current measurement, oldest mixture first.

    All mixtures or the named; variants are left out. A mixture without a prediction
    has the state ``open``; ``outdated`` is a prediction of other proportions, tests or sieves than the store's, or
    of an older engine than ``engine_version``, by default the newest there. Raises UnknownName.
    """
    with target.read() as session:
        rows = store.mixtures(session, names)
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
        for report in [report_of(one, _outdated(one, stale, known, newest_engine)) for one in found.get(row.id, [])]
        or [_openreport_of(row)]
    ]
    beside = {rule: _by_mixture(rows, parts, rule) for rule in {_one_rule(report) for report in reports}}
    return [
        with_theory(
            with_expected_error(report, *spread.get((report.method, report.engine_version), (0, 0.0))),
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


def _openreport_of(row: Mixture) -> PredictionReport:
    measured = measured_mixture(row)
    return PredictionReport(
        mixture=row.name,
        measured=measured.packing_density if measured else None,
        measured_error=measured.standard_error if measured else None,
        state="open",
        notes=("not predicted yet: run 'pdlab predict'",),
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
    parts = open_blend(row.mixture, known).parts
    try:
        bed = mixture.next_specimens(parts, [], stiffer=stiffer_than(parts, row))[0]
    except PdlabError:  # what the rows say now cannot be simulated at all
        return False
    return bed.digest(row.engine_version or 0) in {run.specimen_hash for run in row.runs}
