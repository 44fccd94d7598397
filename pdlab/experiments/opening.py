"""An aggregate on its way to a calibration: what was measured of it, and the beds along its curve."""

import math
from dataclasses import dataclass, field
from typing import Any

from pdlab import angles, grading
from pdlab.calibration import ANGLE, GRADED, REPOSE, Calibrated, Ladder, Measured
from pdlab.errors import AngleError, PdlabError
from pdlab.experiments.readings import (
    angle_protocols,
    current_tests,
    doubts,
    measured_test,
    particle_density,
    protocol_text,
    required_grading,
    spheres_text,
    wall_friction,
)
from pdlab.experiments.ways import Way
from pdlab.grading import Grading
from pdlab.models import Aggregate, Calibration, SieveAnalysis
from pdlab.specimen import Packing, Protocol, Sizes, on_grid, protocol_of


@dataclass
class Open:
    """An aggregate on its way to a calibration.

    ``method``: the one that is tried, of ``auto`` one after the other. ``tested``: what its row says of the test
    that it is calibrated to. ``curve_protocol``: of the beds along its curve; ``protocol``: of those whose packing
    density the calibration gives, and of mixtures. ``beds``: by friction, those of spheres with the measured angle.
    ``kept``: the stored calibration to the same facts; ``settled``: and that is the one last asked for.
    """

    aggregate: Aggregate
    grading: Grading
    way: Way
    method: str
    measured: Measured
    tested: dict[str, Any]
    curve_protocol: Protocol
    protocol: Protocol
    warnings: list[str]
    choice: str = ""
    beds: dict[float, list[Packing]] = field(default_factory=dict)
    result: Calibrated | None = None
    error: PdlabError | None = None
    kept: Calibration | None = None
    settled: bool = False

    def __post_init__(self) -> None:
        self.diameter = grading.equivalent_diameter(self.grading, self.way.rule)

    @property
    def analysis(self) -> SieveAnalysis:
        """The current sieve analysis."""
        return self.aggregate.sieve_analyses[-1]

    @property
    def runs(self) -> list[Packing]:
        """The runs of its ``beds``."""
        return [bed for several in self.beds.values() for bed in several]

    def sizes(self, method: str) -> Sizes:
        """Return the spheres [mm] that stand for it by a method."""
        if method == GRADED:
            return grading.sieve_classes(self.grading, self.way.leave_out or 0.0)
        return ((self.diameter, 1.0),)

    def ladder(self, method: str | None = None) -> Ladder:
        """Return the beds of its curve, in units of its largest sphere: aggregates alike but for size share them."""
        method = method or self.method
        sizes = self.sizes(method)
        reduced = tuple((on_grid(size / sizes[0][0]), on_grid(share)) for size, share in sizes)
        return Ladder(method, reduced, self.curve_protocol)

    def left_out(self) -> list[str]:
        """Return what is left out of its graded spheres, as a sentence."""
        finest = self.way.leave_out
        if self.method != GRADED or finest is None:
            return []
        lost = math.fsum(share for size, share in grading.sieve_classes(self.grading) if size < finest)
        return [f"{100.0 * lost:.3g} % of the solids, finer than {finest:g} mm, are left out"] if lost else []

    def facts(self) -> dict[str, Any]:
        """Return what the calibration is worked out from, as its row names it."""
        method = self.method
        return self.tested | {
            "aggregate_id": self.aggregate.id,
            "sieve_analysis_id": self.analysis.id,
            "method": method,
            "variant": self.way.variant,
            "protocol": protocol_text(self.protocol),
            "diameter_rule": self.way.rule,
            "diameter_mm": self.diameter,
            "spheres": spheres_text(method, self.grading, self.way.leave_out),
            "leave_out_below_mm": self.way.leave_out if method == GRADED else None,
        }

    def is_kept_by(self, row: Calibration) -> bool:
        """Return whether a stored calibration was worked out from the same facts."""
        facts = self.facts()
        if self.ladder().sought is not ANGLE:  # whose row holds its error in PD
            facts["input_error"] = self.measured.standard_error
        return all(getattr(row, name) == value for name, value in facts.items())


def open_calibration(row: Aggregate, way: Way) -> Open:
    """Return an aggregate on its way to a calibration to its current tests.

    Raises InputError where a test is missing, AngleError, DensityError, GradingError.
    """
    return _to_angle(row, way) if way.method == REPOSE else _to_density(row, way)


def _to_density(row: Aggregate, way: Way) -> Open:
    sieved, test = current_tests(row, way.pan_factor)
    measured = measured_test(test, particle_density(row))
    tested = {"packing_test_id": test.id, "measured_packing_density": measured.packing_density}
    protocol = way.set(protocol_of(test.compaction))
    warnings = [*doubts(row, sieved, test), *measured.warnings]
    return Open(row, sieved, way, way.method, measured, tested, protocol, protocol, warnings)


def _to_angle(row: Aggregate, way: Way) -> Open:
    sieved = required_grading(row, way.pan_factor)
    if row.repose_angle_deg is None:
        raise AngleError(f"aggregate '{row.name}' has no angle of repose; enter repose_angle_deg")
    measured, wall = angles.measured_angle(row.repose_angle_deg), wall_friction(row)
    tested = {
        "packing_test_id": None, "measured_packing_density": None, "measured_angle_deg": measured.value,
        "wall_friction": wall,
    }  # fmt: skip
    heaped, shaken = (way.set(protocol) for protocol in angle_protocols(wall))
    warnings = [*doubts(row, sieved), *measured.warnings]
    return Open(row, sieved, way, way.method, measured, tested, heaped, shaken, warnings)
