"""How aggregates become spheres: by which method, diameter rule and number of seeds, and what is assumed."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from pdlab import calibration, grading
from pdlab.calibration import GRADED, MONOSIZED, REPOSE, ROLLING
from pdlab.errors import DamagedRow, InputError
from pdlab.experiments.addresses import address
from pdlab.experiments.readings import REMEDY, kept
from pdlab.experiments.references import REFERENCES
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Base, Calibration, Prediction, Sweep
from pdlab.specimen import Protocol

AUTO = "auto"
METHODS = (MONOSIZED, ROLLING, GRADED)
"""Methods that calibrate to a density test; ``auto`` takes the first of them that reaches it."""
OTHERS = (REPOSE, AUTO)


@dataclass(frozen=True)
class Way:
    """How aggregates become spheres: a ``method``, a diameter ``rule``, ``seeds`` beds at a node of the curve.

    ``leave_out``: graded spheres finer than this [mm] are left out, None for none. ``variant``: the name of an
    assumption that is made differently, by the rule, by ``settings`` of the protocol, or by a ``pan_factor`` on the
    lower size that is assumed of pans without one.
    """

    method: str = MONOSIZED
    rule: str = DEFAULT_RULE
    seeds: int = calibration.SEEDS
    leave_out: float | None = None
    variant: str = ""
    settings: tuple[tuple[str, Any], ...] = ()
    pan_factor: float = 1.0

    def __post_init__(self) -> None:
        known = (*METHODS, *OTHERS, *REFERENCES)
        if self.method not in known:
            raise InputError(f"'{self.method}' is no method; use one of {', '.join(known)}")
        if self.rule not in grading.RULES:
            raise InputError(f"'{self.rule}' is no diameter rule; use one of {', '.join(grading.RULES)}")
        if self.seeds < calibration.LEAST_SEEDS:
            raise InputError(f"{self.seeds} seeds give no standard error; use at least {calibration.LEAST_SEEDS}")
        if self.leave_out is not None and not self.leave_out > 0.0:
            raise InputError(f"a size of {self.leave_out:g} mm leaves nothing out; give one above 0")
        if self.leave_out is not None and self.method not in (GRADED, AUTO):
            raise InputError(
                f"'{self.method}' has one size, of which nothing can be left out; use the method '{GRADED}' or '{AUTO}'"
            )

    def text(self) -> str:
        """Return all but method and variant as JSON, as it is kept with a wish; see ``way_kept``."""
        facts = asdict(self)
        return json.dumps({name: facts[name] for name in sorted(facts.keys() - {"method", "variant"})})

    def set(self, protocol: Protocol) -> Protocol:
        """Return a protocol with the settings that are made differently."""
        return replace(protocol, **dict(self.settings))


def way_kept(row: Calibration | Prediction | Sweep) -> Way:
    """Return the way that a wish asks for. Raises DamagedRow for what is none."""

    def read(asked: dict[str, Any]) -> Way:
        settings = tuple((name, value) for name, value in asked.pop("settings", ()))
        return Way(method=row.method, variant=row.variant, settings=settings, **asked)

    return kept(row, "asked", read) if row.asked else _named(row, partial(read, {}))


def way_of(fit: Calibration) -> Way:
    """Return the way that a calibration was made by. Raises DamagedRow for what is none."""
    return _named(fit, partial(Way, fit.method, fit.diameter_rule, leave_out=fit.leave_out_below_mm))


def _named(row: Base, make: Callable[[], Way]) -> Way:
    try:
        return make()
    except InputError as error:
        raise DamagedRow(f"{address(row)}: {error}; {REMEDY}") from error
