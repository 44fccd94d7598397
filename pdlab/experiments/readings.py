"""What stored rows say: gradings, particle densities, measured packing densities."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pdlab import angles, density, grading, store
from pdlab.calibration import GRADED
from pdlab.density import MeasuredPacking
from pdlab.errors import AngleError, DamagedRow, GradingError, InputError, ProtocolError
from pdlab.experiments.addresses import address
from pdlab.grading import Grading
from pdlab.models import Aggregate, Base, Calibration, Mixture, PackingTest, Prediction, Run
from pdlab.specimen import REPOSE, VIBRATED, Packing, Protocol, Specimen, from_canonical, on_grid, protocol_of
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS

T = TypeVar("T")
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


def current_grading(aggregate: Aggregate, pan_factor: float = 1.0) -> Grading | None:
    """Return an aggregate's current grading, None where it was not sieved.

    ``pan_factor`` [-]: of the lower size that is assumed of a pan without one.
    """
    if not aggregate.sieve_analyses:
        return None
    return grading.make_grading(sieve_table(aggregate.sieve_analyses[-1]), pan_factor)


def required_grading(aggregate: Aggregate, pan_factor: float = 1.0) -> Grading:
    """Return an aggregate's current grading. Raises InputError where it was not sieved."""
    sieved = current_grading(aggregate, pan_factor)
    if sieved is None:
        raise InputError(f"aggregate '{aggregate.name}' has no sieve analysis; enter one")
    return sieved


def wall_friction(aggregate: Aggregate) -> float | None:
    """Return the friction of walls [-] from an aggregate's slip angle, None where none was entered. Raises AngleError.

    On the grid that it is simulated on.
    """
    return None if aggregate.wall_angle_deg is None else on_grid(angles.wall_friction(aggregate.wall_angle_deg))


def angle_protocols(wall: float | None) -> tuple[Protocol, Protocol]:
    """Return how an angle of repose is simulated, and then the packing density of what has it.

    ``wall``: friction of base, cylinder and floor [-], None for the protocol's rule.
    """
    return replace(REPOSE, wall_friction=wall), replace(VIBRATED, wall_friction=wall)


def current_tests(aggregate: Aggregate, pan_factor: float = 1.0) -> tuple[Grading, PackingTest]:
    """Return an aggregate's current grading and density test. Raises InputError where one is missing."""
    sieved, test = required_grading(aggregate, pan_factor), store.newest_test(aggregate.packing_tests)
    if test is None:
        raise InputError(f"aggregate '{aggregate.name}' has no density test; enter one")
    return sieved, test


def packing_of(run: Run) -> Packing:
    """Return a stored run as the packing, or the heap, that it gave."""
    return Packing(
        digest=run.specimen_hash,
        packing_density=math.nan if run.packing_density is None else run.packing_density,
        coordination_number=float(run.coordination_number or 0.0),
        height=float(run.height or 0.0),
        slab_shares=kept(run, "slab_shares", lambda value: tuple(map(float, value))) if run.slab_shares else (),
        largest_overlap=float(run.largest_overlap or 0.0),
        rest=run.rest or "",
        steps=int(run.steps or 0),
        seconds=float(run.seconds or 0.0),
        engine_version=run.engine_version,
        warnings=tuple((run.warnings or "").splitlines()),
        repose_angle_deg=run.repose_angle_deg,
    )


def spheres_text(method: str, sieved: Grading, leave_out: float | None) -> str | None:
    """Return the sizes [mm] and shares of graded spheres as they are kept with a calibration, None for one size."""
    if method != GRADED:
        return None
    try:
        return json.dumps(grading.sieve_classes(sieved, leave_out or 0.0))
    except GradingError:
        return ""


COHESIVE, MOST_COHESIVE = 0.125, 0.05
"""Grains finer than this [mm] stick to each other: more than this share of them is warned about."""
NARROW = 10.0
"""Largest sizes that a container is to be wide."""
DISAGREEING = 3.0
"""Standard errors of their difference by which two current density tests may disagree."""


def doubts(aggregate: Aggregate, sieved: Grading, test: PackingTest | None = None) -> list[str]:
    """Return what speaks against a calibration, to a density ``test`` if to one, or was assumed in it."""
    out = [*sieved.warnings, *(_doubts_of_test(aggregate, sieved, test) if test is not None else ())]
    fines = grading.passing_at(sieved, COHESIVE)
    if fines > MOST_COHESIVE:
        out.append(
            f"{100.0 * fines:.3g} % are finer than {COHESIVE:g} mm, more than {100.0 * MOST_COHESIVE:g} %: they "
            "stick to each other (cohesion), which is not simulated, and pack looser than predicted"
        )
    return out if test is None else out + _disagreement(aggregate, test)


def _doubts_of_test(aggregate: Aggregate, sieved: Grading, test: PackingTest) -> list[str]:
    out, coarsest = list[str](), sieved.apertures[0]
    if test.compaction == "unstated":
        out.append("the density test's compaction is not stated: it is simulated as loose")
    if test.container_diameter_mm is not None and test.container_diameter_mm < NARROW * coarsest:
        out.append(
            f"the container is {test.container_diameter_mm / coarsest:.3g} times as wide as the largest grain, less "
            f"than {NARROW:g}: its wall loosens the packing, which is taken for friction; test in a wider one"
        )
    absorbed = aggregate.water_absorption_percent or 0.0
    if (test.moisture_percent or 0.0) > absorbed:
        out.append(
            f"the tested material held {test.moisture_percent:g} % of water, more than the {absorbed:g} % it absorbs: "
            "moist grains pack looser (bulking), which is taken for friction; test it dry"
        )
    return out


def _disagreement(aggregate: Aggregate, test: PackingTest) -> list[str]:
    """Return by how much the test before, of the same compaction, disagrees, where it is too much for chance."""
    earlier = [one for one in aggregate.packing_tests if one.compaction == test.compaction and one.id < test.id]
    before = store.newest_test(earlier)
    if before is None:
        return []
    now, then = (measured_test(one, particle_density(aggregate)) for one in (test, before))
    off = abs(now.packing_density - then.packing_density)
    allowed = DISAGREEING * math.hypot(now.standard_error, then.standard_error)
    if off <= allowed:
        return []
    return [
        f"the last two {test.compaction} density tests disagree by {off:.4f} in PD ({then.packing_density:.4f}, then "
        f"{now.packing_density:.4f}), more than {DISAGREEING:g} standard errors ({allowed:.4f}): the newer one is taken"
    ]


CANNOT_BE = (ArithmeticError, AssertionError, AttributeError, LookupError, StopIteration, TypeError, ValueError)
"""What becomes of a row that pdlab did not write, wherever it is read."""
REMEDY = "put a backup in the store's place"


def kept(row: Base, column: str, read: Callable[[Any], T]) -> T:
    """Return what a row keeps as JSON in a column, as ``read`` makes it. Raises DamagedRow, naming the row."""
    text = getattr(row, column)
    try:
        return read(json.loads(text))
    except (*CANNOT_BE, InputError) as error:
        raise DamagedRow(
            f"{address(row)}: {column} '{str(text)[:40]}' is not what pdlab wrote ({error}); {REMEDY}"
        ) from error


def an_object(value: Any) -> dict[str, Any]:
    """Return what JSON held if that is an object. Raises TypeError."""
    if not isinstance(value, dict):
        raise TypeError("no object")
    return value


def protocol_kept(row: Calibration | Prediction) -> Protocol:
    """Return the protocol that was kept with a result; what an older version did not name is the default."""
    return kept(row, "protocol", lambda value: Protocol(**value))


def specimen_kept(run: Run) -> Specimen:
    """Return the specimen of a run. Raises ProtocolError, naming the run."""
    try:
        return from_canonical(run.specimen)
    except ProtocolError as error:
        raise ProtocolError(f"{address(run)}: {error}") from error


def protocol_text(protocol: Protocol) -> str:
    """Return a protocol as it is kept with its results."""
    return json.dumps(protocol.settings(), sort_keys=True)


def is_stale(fit: Calibration) -> bool:
    """Return whether a calibration's aggregate was tested or sieved anew since, or what it rests on was corrected.

    One to an angle does not rest on density tests.
    """
    row = fit.aggregate
    sieved = current_grading(row)
    if sieved is None or row.sieve_analyses[-1].id != fit.sieve_analysis_id:
        return True
    return (
        grading.equivalent_diameters(sieved, [fit.diameter_rule])[fit.diameter_rule] != fit.diameter_mm
        or spheres_text(fit.method, sieved, fit.leave_out_below_mm) != fit.spheres
        or (_other_test(fit) if fit.measured_angle_deg is None else _other_angles(fit))
    )


def _other_test(fit: Calibration) -> bool:
    test = store.newest_test(fit.aggregate.packing_tests)
    if test is None or test.id != fit.packing_test_id:
        return True
    measured = measured_test(test, particle_density(fit.aggregate))
    return (
        measured.packing_density != fit.measured_packing_density
        or (fit.state == "done" and measured.standard_error != fit.input_error)
        or protocol_text(protocol_of(test.compaction)) != fit.protocol
    )


def _other_angles(fit: Calibration) -> bool:
    try:
        wall = wall_friction(fit.aggregate)
    except AngleError:  # corrected to what is none
        return True
    moved = fit.aggregate.repose_angle_deg != fit.measured_angle_deg
    return moved or protocol_text(angle_protocols(wall)[1]) != fit.protocol  # which holds the wall's friction


def older_engine(version: int | None, newest: int | None) -> str:
    """Return what to say of a result of an older engine than the ``newest``; empty where it is none."""
    if version is None or newest is None or version >= newest:
        return ""
    return f"by an older engine (version {version}); run 'pdlab refresh'"


@dataclass(frozen=True)
class Summary:
    """What is known of an aggregate: its current tests, and their calibration or why there is none.

    ``diameter`` [mm] by the default rule; ``friction`` [-] with the ends of its interval, None where open; ``rolling``
    friction [-] where that was calibrated; ``method``: of the calibration.
    """

    aggregate_id: int
    name: str
    delivery: str
    source: str | None
    grading: Grading | None
    diameter: float | None
    measured: MeasuredPacking | None
    friction: float | None = None
    friction_low: float | None = None
    friction_high: float | None = None
    rolling: float | None = None
    method: str = ""
    message: str = ""


def summaries(target: Store, engine_version: int | None = None, ids: Sequence[int] | None = None) -> list[Summary]:
    """Return what is known of each aggregate's newest delivery, or of the deliveries with these ``ids``.

    A calibration of an older engine than ``engine_version``, by default the newest in the store, says so.
    """
    with target.read() as session:
        rows = store.aggregates(session) if ids is None else store.aggregates_by_id(session, ids)
        newest = engine_version or store.newest_engine(session)
        last: dict[int, Calibration] = {}
        for fit in store.calibrations(session, [row.id for row in rows]):
            if not fit.variant and not is_stale(fit):
                last.setdefault(fit.aggregate_id, fit)
    return [_summary(row, last.get(row.id), newest) for row in rows]


def _summary(row: Aggregate, fit: Calibration | None, newest: int | None) -> Summary:
    sieved = current_grading(row)
    diameter = grading.equivalent_diameter(sieved) if sieved else None
    known = Summary(row.id, row.name, row.delivery, row.source, sieved, diameter, measured_aggregate(row))
    if fit is None:
        return known
    return replace(
        known, friction=fit.friction, friction_low=fit.friction_low, friction_high=fit.friction_high,
        rolling=fit.rolling_friction, method=fit.method,
        message=fit.message or older_engine(fit.engine_version, newest),
    )  # fmt: skip
