"""The assumption sheet: what a mixture's packing density owes to choices that no test of the aggregates decides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pdlab import grading, store
from pdlab.errors import InputError
from pdlab.experiments.predictions import predict
from pdlab.experiments.readings import sieve_table
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.ways import Way
from pdlab.plan import RunAll
from pdlab.specimen import PAIR_FRICTIONS
from pdlab.store import Store

RULES, DAMPING, PAIRS, PAN = "diameter rule", "local damping", "pair friction", "assumed pan size"
CHOICES = (RULES, DAMPING, PAIRS, PAN)


@dataclass(frozen=True)
class Assumed:
    """One choice made differently: its kind, its name and what the whole chain then predicts."""

    choice: str
    name: str
    report: PredictionReport


@dataclass(frozen=True)
class Sheet:
    """A mixture's prediction and what it becomes where one choice after the other is made differently."""

    mixture: str
    report: PredictionReport
    assumed: tuple[Assumed, ...]

    def spread(self, choice: str) -> float | None:
        """Return the largest minus the least packing density [-] over the ways of one choice, None with one way."""
        others = [one.report.packing_density for one in self.assumed if one.choice == choice]
        known = [value for value in (self.report.packing_density, *others) if value is not None]
        return max(known) - min(known) if len(known) > 1 else None


def sheet(target: Store, run_all: RunAll, names: Sequence[str] = (), way: Way | None = None) -> list[Sheet]:
    """Predict mixtures by the whole chain, calibrations included, once as usual and once for each other choice.

    The choices: every other diameter rule, no local damping, the pair's friction by the mean and the geometric mean
    instead of the minimum, and half and twice the lower size that is assumed of pans without one. To a geometric
    reference only the rule and the pans matter. What cannot be worked out stands with its error. Raises UnknownName,
    and InputError for a way that is itself a variant.
    """
    way = way or Way()
    if way.variant:
        raise InputError(f"'{way.variant}' is a variant already; ask for the sheet of the method as it is")
    usual = predict(target, run_all, names, way)
    mixtures = [report.mixture for report in usual]
    pans = _with_assumed_pans(target, mixtures)
    assumed: dict[str, list[Assumed]] = {name: [] for name in mixtures}
    for choice, name, other in variants_of(way):
        asked = [one for one in mixtures if choice != PAN or one in pans]
        for report in predict(target, run_all, asked, other) if asked else ():
            assumed[report.mixture].append(Assumed(choice, name, report))
    return [Sheet(report.mixture, report, tuple(assumed[report.mixture])) for report in usual]


def _with_assumed_pans(target: Store, mixtures: Sequence[str]) -> set[str]:
    """Return the mixtures of which an aggregate's pan holds something and has no lower size."""
    with target.read() as session:
        rows = store.mixtures(session, mixtures)
        ids = list({part.aggregate_id for row in rows for part in row.components})
        analyses = {one.id: one.sieve_analyses[-1:] for one in store.aggregates_by_id(session, ids)}
    assuming = {key for key, last in analyses.items() if any(grading.assumes_pan(sieve_table(one)) for one in last)}
    return {row.name for row in rows if any(part.aggregate_id in assuming for part in row.components)}


def variants_of(way: Way) -> list[tuple[str, str, Way]]:
    """Return every choice made differently that matters to the method: its kind, its name, the way."""
    rules = [(RULES, rule, replace(way, rule=rule, variant=f"diameter_rule={rule}")) for rule in grading.RULES]
    undamped = replace(way, variant="local_damping=0", settings=(("local_damping", 0.0),))
    pairs = [
        (PAIRS, rule, replace(way, variant=f"pair_friction={rule}", settings=(("pair_friction", rule),)))
        for rule in PAIR_FRICTIONS[1:]
    ]
    pans = [
        (PAN, f"{factor:g} times", replace(way, pan_factor=factor, variant=f"assumed_pan_size={factor:g}"))
        for factor in (0.5, 2.0)
    ]
    forces = [] if way.method in REFERENCES else [(DAMPING, "0", undamped), *pairs]
    return [*(one for one in rules if one[1] != way.rule), *forces, *pans]
