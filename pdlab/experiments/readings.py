"""What stored rows say: gradings, particle densities, measured packing densities."""

import json
import math
from dataclasses import dataclass, replace

from pdlab import density, grading, store
from pdlab.density import MeasuredPacking
from pdlab.grading import Grading
from pdlab.models import Aggregate, Calibration, Mixture, PackingTest
from pdlab.specimen import Protocol, protocol_of
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS

sieve_table = store.sieve_table


def particle_density(aggregate: Aggregate) -> float | None:
    """Return an aggregate's oven-dry particle density [kg/m³], None where none was entered."""
    if aggregate.particle_density_kg_m3 is None or aggregate.density_basis is None:
        return None
    return density.oven_dry_density(
        aggregate.particle_density_kg_m3, aggregate.density_basis, aggregate.water_absorption_percent
    )


def mean_density(blend: Mixture) -> float | None:
    """Return a mixture's mean particle density by solid volume [kg/m³], None where one is unknown."""
    known = [(part.solid_volume_share, particle_density(part.aggregate)) for part in blend.components]
    if any(value is None for _, value in known):
        return None
    return math.fsum(share * (value or 0.0) for share, value in known) / math.fsum(share for share, _ in known)


def measured_test(test: PackingTest, particle: float | None) -> MeasuredPacking:
    """Return what a density test says of the packing density. Raises DensityError."""
    kind = next(name for name in DENSITY_KINDS if getattr(test, name) is not None)
    return density.measured_packing(kind, getattr(test, kind), particle, test.repeats, test.standard_deviation)


def measured_aggregate(aggregate: Aggregate) -> MeasuredPacking | None:
    """Return an aggregate's current measured packing density, None where it was not tested."""
    test = store.newest_test(aggregate.packing_tests)
    return None if test is None else measured_test(test, particle_density(aggregate))


def measured_mixture(blend: Mixture) -> MeasuredPacking | None:
    """Return a mixture's current measured packing density, None where it was not tested."""
    test = store.newest_test(blend.packing_tests)
    return None if test is None else measured_test(test, mean_density(blend))


def current_grading(aggregate: Aggregate) -> Grading | None:
    """Return an aggregate's current grading, None where it was not sieved."""
    if not aggregate.sieve_analyses:
        return None
    return grading.make_grading(sieve_table(aggregate.sieve_analyses[-1]))


def protocol_text(protocol: Protocol) -> str:
    """Return a protocol as it is kept with its results."""
    return json.dumps(protocol.settings(), sort_keys=True)


def is_stale(fit: Calibration) -> bool:
    """Return whether an aggregate was tested or sieved anew since its calibration, or one of the two corrected."""
    row = fit.aggregate
    test, sieved = store.newest_test(row.packing_tests), current_grading(row)
    if test is None or sieved is None:
        return True
    if (test.id, row.sieve_analyses[-1].id) != (fit.packing_test_id, fit.sieve_analysis_id):
        return True
    measured = measured_test(test, particle_density(row))
    return (
        measured.packing_density != fit.measured_packing_density
        or (fit.state == "done" and measured.standard_error != fit.input_error)
        or grading.equivalent_diameters(sieved, [fit.diameter_rule])[fit.diameter_rule] != fit.diameter_mm
        or protocol_text(protocol_of(test.compaction)) != fit.protocol
    )


def older_engine(version: int | None, newest: int | None) -> str:
    """Return what to say of a result of an older engine than the ``newest``; empty where it is none."""
    if version is None or newest is None or version >= newest:
        return ""
    return f"of engine version {version}; run 'pdlab refresh'"


@dataclass(frozen=True)
class Summary:
    """What is known of an aggregate: its current tests, and their calibration or why there is none.

    ``diameter`` [mm] by the default rule; ``friction`` [-] with the ends of its interval, None where open.
    """

    name: str
    delivery: str
    source: str | None
    grading: Grading | None
    diameter: float | None
    measured: MeasuredPacking | None
    friction: float | None = None
    friction_low: float | None = None
    friction_high: float | None = None
    message: str = ""


def summaries(target: Store, engine_version: int | None = None) -> list[Summary]:
    """Return what is known of each aggregate's newest delivery.

    A calibration of an older engine than ``engine_version``, by default the newest in the store, says so.
    """
    with target.read() as session:
        rows = store.aggregates(session)
        newest = engine_version or store.newest_engine(session)
        last: dict[int, Calibration] = {}
        for fit in store.calibrations(session, [row.id for row in rows]):
            if not is_stale(fit):
                last.setdefault(fit.aggregate_id, fit)
    return [_summary(row, last.get(row.id), newest) for row in rows]


def _summary(row: Aggregate, fit: Calibration | None, newest: int | None) -> Summary:
    sieved = current_grading(row)
    diameter = grading.equivalent_diameter(sieved) if sieved else None
    known = Summary(row.name, row.delivery, row.source, sieved, diameter, measured_aggregate(row))
    if fit is None:
        return known
    return replace(
        known, friction=fit.friction, friction_low=fit.friction_low, friction_high=fit.friction_high,
        message=fit.message or older_engine(fit.engine_version, newest),
    )  # fmt: skip
