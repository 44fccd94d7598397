"""Compare: how far every method is from the measured mixtures, simulation, theory and plain references alike."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pdlab import comparison, store, theory
from pdlab.calibration import REPOSE
from pdlab.comparison import CONFIDENCE, SEED, Errors, Figure, LeftOut
from pdlab.errors import InputError, ProtocolError, TooFewData
from pdlab.experiments.comparisons import comparisons
from pdlab.experiments.readings import measured_mixture
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.theories import MODELS, VOLUME_MEAN, Recipe, components_of, evaluate, recipes
from pdlab.grading import DEFAULT_RULE
from pdlab.store import Store

CONSTANT, FITTED = "best_constant", "cpm_fitted"
"""The mean of the other measured mixtures; the compressible packing model with K fitted to the others."""

Outcome = float | str
"""A method's packing density of a mixture [-], or why there is none."""


@dataclass(frozen=True)
class MethodErrors:
    """A method's errors over some mixtures; ``gain``: its mean absolute error over the volume mean's, paired."""

    method: str
    mixtures: tuple[str, ...]
    errors: Errors
    gain: Figure | None

    @property
    def figures(self) -> dict[str, Figure]:
        """What has an interval, by name."""
        known = {
            "bias": self.errors.bias,
            "mean_absolute_error": self.errors.mean_absolute,
            "root_mean_square_error": self.errors.root_mean_square,
        }
        return known if self.gain is None else known | {"against_volume_mean": self.gain}

    @property
    def worst(self) -> str:
        """The mixture of the largest error."""
        return self.mixtures[self.errors.where]


@dataclass(frozen=True)
class Compared:
    """Every method beside the measured packing densities [-] of mixtures.

    ``outcomes``: by method and mixture. ``common``: the mixtures that all methods have which have any.
    ``over_common`` and ``over_own``: the errors of each method over those, and over all that it has. ``index``: the
    least and the greatest compaction index K [-] that was fitted. ``unmeasured``: the mixtures without a density test.
    """

    measured: dict[str, float]
    measured_error: float
    outcomes: dict[str, dict[str, Outcome]]
    common: tuple[str, ...]
    over_common: tuple[MethodErrors, ...]
    over_own: tuple[MethodErrors, ...]
    index: tuple[float, float] | None
    unmeasured: tuple[str, ...]

    def difference(self, method: str, mixture: str) -> float | None:
        """Return a method's packing density minus the measured one [-], None where it has none."""
        value = self.outcomes[method][mixture]
        return None if isinstance(value, str) else value - self.measured[mixture]

    def lacking(self, method: str) -> dict[str, list[str]]:
        """Return the mixtures that a method lacks, by the reason."""
        out = dict[str, list[str]]()
        for mixture, value in self.outcomes[method].items():
            if isinstance(value, str):
                out.setdefault(value, []).append(mixture)
        return out


def compare(
    target: Store,
    names: Sequence[str] = (),
    confidence: float = CONFIDENCE,
    seed: int = SEED,
    rule: str = DEFAULT_RULE,
    engine_version: int | None = None,
) -> Compared:
    """Set every method beside the measurements of the named mixtures, or of all.

    Methods: each that simulated one of them (its newest prediction, not outdated), the theories by a diameter
    ``rule``, the mean of the aggregates by volume, and two that are fitted to the other measured mixtures among these.
    ``confidence`` of the intervals [-]; ``seed`` of their resamples. Raises UnknownName, InputError where none of the
    mixtures is measured.
    """
    with target.read() as session:
        rows = store.mixtures(session, names)
        parts = store.aggregates_by_id(session, components_of(rows))
    tests = {row.name: test for row in rows if (test := measured_mixture(row)) is not None}
    if not tests:
        raise InputError("none of these mixtures has a density test to compare with; enter one")
    measured = {name: test.packing_density for name, test in tests.items()}
    asked = [recipe for recipe in recipes(rows, parts, rule) if recipe.mixture in measured]
    fitted = _fitted_index(asked, measured)
    indices = [one.index for one in fitted.values() if isinstance(one, LeftOut)]
    outcomes: dict[str, dict[str, Outcome]] = {
        **_simulated(comparisons(target, engine_version, list(measured)), asked),
        CONSTANT: _constant(measured),
        **_theoretical(asked),
        FITTED: {name: one.packing_density if isinstance(one, LeftOut) else one for name, one in fitted.items()},
    }
    return _compared(
        _Judge(outcomes, measured, confidence, seed),
        measured_error=math.sqrt(math.fsum(test.standard_error**2 for test in tests.values()) / len(tests)),
        index=(min(indices), max(indices)) if indices else None,
        unmeasured=tuple(row.name for row in rows if row.name not in measured),
    )


def _compared(
    judge: "_Judge", measured_error: float, index: tuple[float, float] | None, unmeasured: tuple[str, ...]
) -> Compared:
    """Return the errors over the mixtures that all methods have, and over each one's own."""
    own = {
        method: tuple(name for name, value in values.items() if not isinstance(value, str))
        for method, values in judge.outcomes.items()
    }
    common = tuple(name for name in judge.measured if all(name in has for has in own.values() if has))
    return Compared(
        measured=judge.measured,
        measured_error=measured_error,
        outcomes=judge.outcomes,
        common=common,
        over_common=tuple(judge.errors(method, common) for method, has in own.items() if has and common),
        over_own=tuple(judge.errors(method, has) for method, has in own.items() if has),
        index=index,
        unmeasured=unmeasured,
    )


@dataclass(frozen=True)
class _Judge:
    """What all methods are judged by: the outcomes beside the measurements, the intervals' confidence and seed."""

    outcomes: dict[str, dict[str, Outcome]]
    measured: dict[str, float]
    confidence: float
    seed: int

    def errors(self, method: str, mixtures: Sequence[str]) -> MethodErrors:
        """Return a method's errors over mixtures that it has, and its gain over those that the volume mean has too."""
        paired, gain = [name for name in mixtures if not isinstance(self.outcomes[VOLUME_MEAN][name], str)], None
        if paired and method != VOLUME_MEAN:
            ours, theirs = self._off(method, paired), self._off(VOLUME_MEAN, paired)
            gain = comparison.gain_over(ours, theirs, self.confidence, self.seed)
        found = comparison.errors_of(self._off(method, mixtures), self.confidence, self.seed)
        return MethodErrors(method, tuple(mixtures), found, gain)

    def _off(self, method: str, mixtures: Sequence[str]) -> list[float]:
        return [float(self.outcomes[method][name]) - self.measured[name] for name in mixtures]


def _simulated(reports: Sequence[PredictionReport], asked: Sequence[Recipe]) -> dict[str, dict[str, Outcome]]:
    """Return the newest predictions by method and mixture, or why there is none that says something now."""
    compactions = {recipe.mixture: recipe for recipe in asked}
    predicted = [report for report in reports if report.state != "open"]
    out: dict[str, dict[str, Outcome]] = {
        method: {recipe.mixture: "not predicted yet" for recipe in asked}
        for method in dict.fromkeys(report.method for report in predicted)
    }
    for report in predicted:
        value: Outcome = f"{report.state}: {report.message}"
        if report.state == "done" and report.packing_density is not None:
            value = report.packing_density
            recipe = compactions[report.mixture]
            try:
                if report.method == REPOSE and recipe.compaction != "vibrated":
                    raise ProtocolError(f"'{REPOSE}' is vibrated and the mixture is not; test it vibrated")
                if report.method not in (REPOSE, *REFERENCES):  # beds are compacted as the aggregates' tests were
                    theory.check_compaction(report.method, recipe.materials, recipe.compaction)
            except InputError as error:
                value = str(error)
        out[report.method][report.mixture] = value
    return out


def _theoretical(asked: Sequence[Recipe]) -> dict[str, dict[str, Outcome]]:
    """Return what the theories and the volume mean make of mixtures, by method and mixture."""
    found = evaluate(asked, tuple(MODELS))
    return {
        method: {one.mixture: one.values.get(method, str(one.errors.get(method))) for one in found} for method in MODELS
    }


def _constant(measured: Mapping[str, float]) -> dict[str, Outcome]:
    """Return for each mixture the mean of the others' measured packing densities [-]."""
    try:
        values: list[float] = comparison.best_constant(list(measured.values())).tolist()
    except TooFewData as error:
        return dict.fromkeys(measured, str(error))
    return dict(zip(measured, values, strict=True))


def _fitted_index(asked: Sequence[Recipe], measured: Mapping[str, float]) -> dict[str, LeftOut | str]:
    """Return the packing densities at the compaction index fitted to the others of the same compaction."""
    out, groups = dict[str, LeftOut | str](), dict[str | None, list[Recipe]]()
    for recipe in asked:
        ways = {material.compaction for material in recipe.materials}
        if recipe.error is not None:
            out[recipe.mixture] = str(recipe.error)
        elif ways != {recipe.compaction}:
            tested = " and ".join(sorted(str(way) for way in ways))
            out[recipe.mixture] = (
                f"the aggregates were tested {tested}, the mixture {recipe.compaction or 'in a way not stated'}: "
                "a fitted K takes both as compacted alike; enter tests of the same kind"
            )
        else:
            groups.setdefault(recipe.compaction, []).append(recipe)
    for group in groups.values():
        out |= _fitted_group(group, [measured[recipe.mixture] for recipe in group])
    return {recipe.mixture: out[recipe.mixture] for recipe in asked}


def _fitted_group(group: Sequence[Recipe], measured: Sequence[float]) -> dict[str, LeftOut | str]:
    """Return the same for mixtures of one compaction."""
    columns = {material: None for recipe in group for material in recipe.materials}
    materials = list(columns)
    shares = np.zeros((len(group), len(materials)))
    for row, recipe in enumerate(group):
        for material, share in zip(recipe.materials, recipe.shares, strict=True):
            shares[row, materials.index(material)] += share
    try:
        found = comparison.fitted_to_the_others(materials, shares, measured)
    except InputError as error:
        return {recipe.mixture: str(error) for recipe in group}
    return {
        recipe.mixture: one if isinstance(one, LeftOut) else str(one) for recipe, one in zip(group, found, strict=True)
    }
