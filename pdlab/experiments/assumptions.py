"""The assumption sheet: what a mixture's packing density owes to choices that no test of the aggregates decides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pdlab import grading
from pdlab.errors import InputError
from pdlab.experiments.calibrations import Way
from pdlab.experiments.curves import RunAll
from pdlab.experiments.predictions import PredictionReport, predict
from pdlab.specimen import PAIR_FRICTIONS
from pdlab.store import Store

RULES, DAMPING, PAIRS = "diameter rule", "local damping", "pair friction"
CHOICES = (RULES, DAMPING, PAIRS)


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

    The choices: every other diameter rule, no local damping beside that of the pouring, the pair's friction by the
    mean and the geometric mean beside the minimum. What cannot be worked out stands with its error. Raises
    UnknownName, and InputError for a way that is itself a variant.
    """
    way = way or Way()
    if way.variant:
        raise InputError(f"'{way.variant}' is a variant already; ask for the sheet of the method as it is")
    usual = predict(target, run_all, names, way)
    mixtures = [report.mixture for report in usual]
    variants = [(choice, name, predict(target, run_all, mixtures, other)) for choice, name, other in variants_of(way)]
    return [
        Sheet(report.mixture, report, tuple(Assumed(choice, name, others[k]) for choice, name, others in variants))
        for k, report in enumerate(usual)
    ]


def variants_of(way: Way) -> list[tuple[str, str, Way]]:
    """Return every choice made differently: its kind, its name, the way."""
    rules = [(RULES, rule, replace(way, rule=rule, variant=f"diameter_rule={rule}")) for rule in grading.RULES]
    undamped = replace(way, variant="local_damping=0", settings=(("local_damping", 0.0),))
    pairs = [
        (PAIRS, rule, replace(way, variant=f"pair_friction={rule}", settings=(("pair_friction", rule),)))
        for rule in PAIR_FRICTIONS[1:]
    ]
    return [one for one in rules if one[1] != way.rule] + [(DAMPING, "0", undamped), *pairs]
