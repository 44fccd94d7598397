"""A size distribution → the one diameter of the equal spheres that stand for it, by named rules."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from pdlab.errors import GradingError
from pdlab.grading.indices import size_at
from pdlab.grading.sieving import Grading

DEFAULT_RULE = "log_mean"


def _log_mean(grading: Grading) -> float:
    return math.exp(float(np.dot(grading.shares, np.log(grading.sizes))))


def _harmonic(grading: Grading) -> float:
    return 1.0 / float(np.dot(grading.shares, 1.0 / grading.sizes))


def _arithmetic(grading: Grading) -> float:
    return float(np.dot(grading.shares, grading.sizes))


def _number_volume(grading: Grading) -> float:
    number = float(np.dot(grading.shares, grading.sizes**-3.0))
    return math.pow(number, -1.0 / 3.0)


def _d50(grading: Grading) -> float:
    return size_at(grading, 0.5)


BEYOND = math.log(1000.0)
"""Logarithm of how many times beyond the sieves a fitted size may lie."""


def _rrsb_d63(grading: Grading) -> float:
    """Fit ln(-ln retained) = n (ln d - ln d63) to the sieves that neither all nor nothing passes."""
    passing, apertures = grading.passing[: grading.sieves], np.array(grading.apertures[: grading.sieves])
    inside = (passing > 0.0) & (passing < 1.0)
    if inside.sum() < 2:
        raise GradingError(
            f"the rule rrsb_d63 needs 2 sieves that part of the material passes, this table has {inside.sum()}; "
            "choose another rule, such as log_mean"
        )
    slope, offset = np.polyfit(np.log(apertures[inside]), np.log(-np.log(1.0 - passing[inside])), 1)
    if not slope > 0.0:
        raise GradingError("the rule rrsb_d63 finds no rising line through this table; choose log_mean")
    size = -offset / slope
    if not -BEYOND <= size - math.log(apertures[-1]) <= math.log(apertures[0] / apertures[-1]) + BEYOND:
        raise GradingError(
            f"the rule rrsb_d63 finds d63 more than {math.exp(BEYOND):.0f} times beyond this table's sieves; choose "
            "log_mean"
        )
    return math.exp(size)


RULES: dict[str, Callable[[Grading], float]] = {
    "log_mean": _log_mean,
    "harmonic": _harmonic,
    "arithmetic": _arithmetic,
    "number_volume": _number_volume,
    "d50": _d50,
    "rrsb_d63": _rrsb_d63,
}
"""Rules for the equivalent diameter: log_mean exp(Σ w ln d), as Dewar's theory weighs sizes;
harmonic 1/Σ(w/d), Sauter's; arithmetic Σ w d; number_volume (Σ w/d³)^(−1/3); d50, interpolated over
log aperture; rrsb_d63 of a Rosin-Rammler-Sperling-Bennett fit."""


def equivalent_diameter(grading: Grading, rule: str = DEFAULT_RULE) -> float:
    """Return the diameter [mm] of the equal spheres that stand for a grading, by a named rule.

    Raises GradingError when the rule is unknown or cannot be applied.
    """
    check_rule(rule)
    return RULES[rule](grading)


def check_rule(rule: str) -> None:
    """Raise GradingError unless there is a diameter rule of this name."""
    if rule not in RULES:
        raise GradingError(f"'{rule}' is no diameter rule; use one of {', '.join(RULES)}")


def equivalent_diameters(grading: Grading, rules: Sequence[str] = tuple(RULES)) -> dict[str, float | None]:
    """Return the diameter [mm] by each rule, None where a rule cannot be applied."""
    out: dict[str, float | None] = {}
    for rule in rules:
        try:
            out[rule] = equivalent_diameter(grading, rule)
        except GradingError:
            out[rule] = None
    return out
