"""Calibrate aggregates: how each becomes spheres, the curve of their packing density, the rows that keep it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy.orm import Session

from pdlab import calibration, store
from pdlab.calibration import GRADED, MONOSIZED, REPOSE, ROLLING, Curve, Ladder, Met
from pdlab.density import MeasuredPacking
from pdlab.errors import InputError, OutOfReach, PdlabError, SpecimenTooLarge, StoreError
from pdlab.experiments.curves import Curves
from pdlab.experiments.opening import Open, open_calibration
from pdlab.experiments.readings import kept, measured_test, particle_density, protocol_kept
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.ways import AUTO, METHODS, OTHERS, Way
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Aggregate, Calibration, CalibrationRun, now
from pdlab.plan import Plan, RunAll, finish
from pdlab.specimen import LOOSE, Packing, Protocol, Sizes
from pdlab.store import Claim, Store

ANSWER = (
    "sieve_analysis_id", "packing_test_id", "method", "protocol", "engine_version", "diameter_rule", "diameter_mm",
    "spheres", "leave_out_below_mm", "measured_packing_density", "measured_angle_deg", "wall_friction", "friction",
    "friction_low", "friction_high", "rolling_friction", "rolling_friction_low", "rolling_friction_high",
    "packing_density", "input_error", "curve_error", "warnings", "state", "message",
)  # fmt: skip
"""The columns of a calibration that say what it was worked out from and what came out."""


@dataclass(frozen=True)
class CalibrationReport:
    """An aggregate's calibration, or the error that stands in its place.

    ``diameter`` [mm] by the ``rule``; ``sizes``: the spheres that stand for the aggregate; ``friction``, ``rolling``
    [-]; ``result``: the calibrated one of the two with its interval. ``measured`` PD [-], NaN where an aggregate
    calibrated to its ``angle`` of repose [degrees] has no vibrated density test; ``wall`` friction [-] from its slip
    angle. ``choice``: why ``auto`` took the method.
    """

    aggregate: str
    aggregate_id: int
    calibration_id: int | None = None
    method: str = MONOSIZED
    diameter: float = math.nan
    rule: str = DEFAULT_RULE
    sizes: Sizes = ()
    measured: float = math.nan
    angle: float | None = None
    wall: float | None = None
    compaction: str = ""
    protocol: Protocol = LOOSE
    friction: float = math.nan
    rolling: float = 0.0
    result: calibration.Calibrated | None = None
    density: float | None = None
    choice: str = ""
    error: PdlabError | None = None

    @property
    def packing_density(self) -> float:
        """The PD [-] that its errors are of: the measured one, or the simulated one of what has the measured angle."""
        return self.measured if self.angle is None or self.result is None else self.result.packing_density


def calibrate(
    target: Store, run_all: RunAll, names: Sequence[str] = (), way: Way | None = None
) -> list[CalibrationReport]:
    """Calibrate the named aggregates, or all; each one's error stands in its report.

    A calibration of the same tests by the same engine is read, never worked out again, unless more ``seeds`` than
    usual are asked for. Runs are shared: what is simulated for one aggregate serves the curve of the next. Raises
    UnknownName, and InputError for a geometric reference.
    """
    way = way or Way()
    rows = to_calibrate(target, names, way)
    return finish(calibrating(target, rows, way, run_all.engine_version), run_all)


def to_calibrate(target: Store, names: Sequence[str], way: Way) -> list[Aggregate]:
    """Return the named aggregates, or all. Raises UnknownName, and InputError for none and for a reference."""
    if way.method in REFERENCES:
        raise InputError(
            f"'{way.method}' is a geometric reference and calibrates nothing; use {', '.join((*METHODS, *OTHERS))}"
        )
    with target.read() as session:
        rows = store.aggregates(session, names)
    if not rows:
        raise InputError("the store holds no aggregate yet; import some, or run 'pdlab demo'")
    return rows


def calibrating(
    target: Store, rows: Sequence[Aggregate], way: Way, engine_version: int, claim: Claim | None = None
) -> Plan[list[CalibrationReport]]:
    """Calibrate aggregates as ``calibrate`` does, each in the delivery that is handed in.

    ``claim``: the wish of one aggregate, in whose row the result is written. Raises ClaimLost.
    """
    reports, waiting = dict[int, CalibrationReport](), dict[int, Open]()
    curves = Curves(target, engine_version)
    for row in rows:
        try:
            waiting[row.id] = open_calibration(row, way)
        except PdlabError as error:
            reports[row.id] = CalibrationReport(row.name, row.id, error=error)
    if way.method == AUTO:
        yield from _choose(target, list(waiting.values()), curves)
    else:
        yield from _work_out(target, list(waiting.values()), curves)
    for one in waiting.values():
        if isinstance(one.error, OutOfReach) and one.method == REPOSE:
            one.error = _elsewhere(one.error)
        elif isinstance(one.error, OutOfReach):
            one.error = yield from _with_reaches(one, one.error, curves)
    reports |= dict(zip(waiting, _save(target, list(waiting.values()), curves, claim), strict=True))
    return [reports[row.id] for row in rows]


def _choose(target: Store, waiting: list[Open], curves: Curves) -> Plan[None]:
    """Take for each aggregate the first method that reaches its density: monosized, then rolling, then graded."""
    for one in waiting:
        one.method = MONOSIZED
    yield from _work_out(target, waiting, curves)
    for method, looser in ((ROLLING, True), (GRADED, False)):
        further = [one for one in waiting if isinstance(one.error, OutOfReach) and one.error.looser == looser]
        for one in further:
            one.choice = f"'{method}' is taken, since {one.error}"
            one.method, one.error = method, None
        yield from _work_out(target, further, curves)


def _work_out(target: Store, waiting: list[Open], curves: Curves) -> Plan[None]:
    """Find each one's coefficient: the one kept in the store, else by its curve."""
    _find_kept(target, waiting, curves.engine_version)
    fresh = [one for one in waiting if one.kept is None]
    for one in fresh:
        try:
            curves.load([one.ladder()])
        except StoreError:
            raise
        except SpecimenTooLarge as error:
            one.error = _too_large(one, error)
        except PdlabError as error:
            one.error = error
    yield from _fill_curves(fresh, curves)
    met = list[tuple[Open, Curve, Met]]()
    for one in fresh:
        known = None if one.error else curves.known(one.ladder())
        if known is not None:
            try:
                if isinstance(one.measured, MeasuredPacking):
                    one.result = calibration.solve(one.measured, known, one.method)
                else:
                    met.append((one, known, calibration.meet(one.measured, known, one.method)))
            except OutOfReach as error:
                one.error = error
    yield from _pack(met)


def _pack(met: Sequence[tuple[Open, Curve, Met]]) -> Plan[None]:
    """Run beds of spheres whose friction was found by their angle, and of those beside it: their packing density."""
    wanted = [
        (one, friction, bed)
        for one, known, found in met
        for friction in dict.fromkeys((found.value, *calibration.beside(found, one.measured, known)))
        for bed in calibration.equal_beds(friction, one.protocol, one.way.seeds)
    ]
    outcomes = (yield [bed for _, _, bed in wanted]) if wanted else ()
    for (one, friction, _), outcome in zip(wanted, outcomes, strict=True):
        if isinstance(outcome, Packing):
            one.beds.setdefault(friction, []).append(outcome)
        else:
            one.error = one.error or outcome
    for one, known, found in met:
        if one.error is None:
            one.result = calibration.packed(found, one.measured, known, one.beds)


def _too_large(one: Open, error: SpecimenTooLarge) -> SpecimenTooLarge:
    """Return the error with the size below which graded spheres would have to be left out."""
    sizes = one.sizes(GRADED)
    for k in range(len(sizes) - 1, 0, -1):
        coarser = replace(one, way=replace(one.way, leave_out=sizes[k - 1][0]))
        try:
            spheres = coarser.ladder(GRADED).beds(calibration.FIRST_NODE, 1)[0].spheres
        except SpecimenTooLarge:
            continue
        lost = 100.0 * math.fsum(share for _, share in sizes[k:])
        return SpecimenTooLarge(
            f"{str(error).split(';')[0]}; leave out what is finer than {sizes[k - 1][0]:.3g} mm, {lost:.3g} % of the "
            f"solids (--leave-out {sizes[k - 1][0]:.3g}), which takes {spheres:,} spheres"
        )
    return error


def _find_kept(target: Store, waiting: list[Open], engine_version: int) -> None:
    """Take what the store holds of calibrations worked out from the same facts by the same engine."""
    usual = [one for one in waiting if one.way.seeds <= calibration.SEEDS]
    with target.read() as session:
        ids = [one.aggregate.id for one in usual]
        rows = store.done_calibrations(session, ids, engine_version)
        newest = store.newest_calibrations(session, ids)
    for one in usual:
        one.kept = next((row for row in rows if one.is_kept_by(row)), None)
        one.settled = one.kept is not None and (bool(one.way.variant) or one.kept.id in newest)


def _missing(one: Open, curves: Curves) -> dict[float, int]:
    """Return the nodes that an aggregate's curve still needs, each with its number of beds."""
    return calibration.missing_nodes(one.measured, curves.known(one.ladder()), one.way.seeds)


def _fill_curves(waiting: list[Open], curves: Curves) -> Plan[None]:
    """Run nodes, round by round, until every aggregate's PD, or angle, is enclosed or out of reach."""
    while True:
        asked = [
            (one, node, seeds) for one in waiting if one.error is None for node, seeds in _missing(one, curves).items()
        ]
        if not asked:
            return
        wanted = dict[tuple[Ladder, float], int]()
        for one, node, seeds in asked:
            wanted[one.ladder(), node] = max(seeds, wanted.get((one.ladder(), node), 0))
        yield from curves.extend(wanted)
        for one, node, _ in asked:
            one.error = one.error or curves.errors.get((one.ladder(), node))


def _with_reaches(one: Open, error: OutOfReach, curves: Curves) -> Plan[OutOfReach]:
    """Return the error with the interval of every method, whose ends are simulated for it, and what to do."""
    ladders = [one.ladder(method) for method in (MONOSIZED, ROLLING)]
    curves.load(ladders)
    yield from curves.extend({(ladder, calibration.NODES[end]): one.way.seeds for ladder in ladders for end in (0, -1)})
    reaches = {ladder.method: curves.reach(ladder) for ladder in ladders}
    if one.method == GRADED:
        reaches[GRADED] = curves.reach(one.ladder())
    spans = [f"'{method}' spans {calibration.span(reach)}" for method, reach in reaches.items()]
    if GRADED not in reaches and not error.looser and len(one.sizes(GRADED)) > 1:
        spans.append(f"'{GRADED}', not simulated for this grading yet, reaches denser beds")
    value = one.measured.value
    reaching = [method for method, (low, high) in reaches.items() if (low or 0.0) <= value <= (high or 1.0)]
    return OutOfReach(
        f"packing density {value:.4g} is out of reach of '{one.method}': {'; '.join(spans)}; "
        f"{_remedy(one, error.looser, [method for method in reaching if method != one.method])}",
        error.looser,
    )


def _elsewhere(error: OutOfReach) -> OutOfReach:
    """Return the error of an angle out of reach with what to do."""
    lies = "steeper than sliding friction makes a heap" if error.looser else "flatter than frictionless spheres lie"
    text = f"{error}: it is {lies}; check the angle, or calibrate to a density test, by the method '{AUTO}'"
    return OutOfReach(text, error.looser)


def _remedy(one: Open, looser: bool, reaching: Sequence[str]) -> str:
    """Return what to do about a density out of reach; ``reaching``: the other methods that reach it."""
    if reaching:
        return f"use the method '{reaching[0]}', or '{AUTO}'"
    if looser:
        return "no method of spheres is so loose: check the test"
    if one.method != GRADED and len(one.sizes(GRADED)) > 1:
        return f"use the method '{GRADED}', or '{AUTO}'"
    return "no bed of these spheres is so dense: check the test and its compaction, or sieve into more classes"


def _row_facts(one: Open, curves: Curves) -> dict[str, Any]:
    """Return a calibration's row but for its runs: what it was worked out from and what came out."""
    facts = one.facts() | {"engine_version": curves.engine_version}
    if one.error is not None or one.result is None:
        return facts | {"state": "failed", "message": str(one.error)}
    result, ends = one.result, (one.result.low, one.result.high)
    friction, rolling = one.ladder().coefficients(result.value)
    of_rolling = one.method == ROLLING
    return facts | {
        "state": "done",
        "message": None,
        "friction": friction,
        "friction_low": None if of_rolling else ends[0],
        "friction_high": None if of_rolling else ends[1],
        "rolling_friction": rolling if of_rolling else None,
        "rolling_friction_low": ends[0] if of_rolling else None,
        "rolling_friction_high": ends[1] if of_rolling else None,
        "packing_density": result.packing_density,
        "input_error": result.input_error,
        "curve_error": result.curve_error,
        "warnings": "\n".join(dict.fromkeys([*one.warnings, *one.left_out(), *result.warnings])) or None,
    }


def _save(target: Store, ready: list[Open], curves: Curves, claim: Claim | None = None) -> list[CalibrationReport]:
    """Write calibrations, or why there are none; of an equal one on the same runs only the time is renewed."""
    settled = [one.kept for one in ready if one.kept is not None and one.settled and claim is None]
    if len(settled) == len(ready):
        pairs = zip(ready, settled, strict=True)
        return [replace(calibration_report(one.aggregate, row), choice=one.choice) for one, row in pairs]
    out = []
    with target.write() as session:
        for one in ready:
            row = _kept(session, one, curves.engine_version)
            facts = _row_facts(one, curves) if row is None else {}
            digests = {packing.digest for packing in (*curves.evidence(one.ladder()), *one.runs)} if facts else set()
            if row is None:
                row = next(iter(store.equal_results(session, Calibration, facts, digests)), None)
            if claim is not None:
                row = _answered(store.claimed(session, Calibration, claim), row, facts, digests)
            elif row is None:
                row = Calibration(**facts, runs=_links(digests))
                store.add_all(session, [row])
            row.progress, row.finished_at = 1.0, row.finished_at or now()
            row.requested_at = now()
            report = calibration_report(one.aggregate, row)
            out.append(replace(report, choice=one.choice, error=one.error))
    return out


def _kept(session: Session, one: Open, engine_version: int) -> Calibration | None:
    """Return the calibration that stands in the store for the same facts, also one that came there meanwhile."""
    if one.kept is not None:
        return store.find_row(session, Calibration, one.kept.id)
    if one.error is not None or one.way.seeds > calibration.SEEDS:
        return None
    rows = store.done_calibrations(session, [one.aggregate.id], engine_version)
    return next((row for row in rows if one.is_kept_by(row)), None)


def _answered(wish: Calibration, equal: Calibration | None, facts: dict[str, Any], digests: set[str]) -> Calibration:
    """Write the result into the row of the wish, as it stands in an equal row if there is one."""
    if equal is not None and equal is not wish:
        facts = {name: getattr(equal, name) for name in ANSWER}
        digests = {link.specimen_hash for link in equal.runs}
    for name, value in facts.items():
        setattr(wish, name, value)
    wish.runs = _links(digests)
    return wish


def _links(digests: set[str]) -> list[CalibrationRun]:
    return [CalibrationRun(specimen_hash=digest) for digest in sorted(digests)]


def _result(row: Calibration) -> calibration.Calibrated:
    rolling = row.method == ROLLING
    return calibration.Calibrated(
        value=float((row.rolling_friction if rolling else row.friction) or 0.0),
        low=row.rolling_friction_low if rolling else row.friction_low,
        high=row.rolling_friction_high if rolling else row.friction_high,
        packing_density=float(row.packing_density or 0.0),
        input_error=float(row.input_error or 0.0),
        curve_error=float(row.curve_error or 0.0),
        warnings=tuple((row.warnings or "").splitlines()),
    )


def _measured(row: Calibration, aggregate: Aggregate) -> float:
    """Return the measured PD of a calibration; of one to an angle that of a vibrated density test, NaN without."""
    if row.measured_angle_deg is None:
        return math.nan if row.measured_packing_density is None else row.measured_packing_density
    test = store.newest_test([test for test in aggregate.packing_tests if test.compaction == "vibrated"])
    return math.nan if test is None else measured_test(test, particle_density(aggregate)).packing_density


def spheres_of(row: Calibration) -> Sizes:
    """Return the spheres that stand for a calibrated aggregate, diameters in mm."""
    if not row.spheres:
        return ((row.diameter_mm, 1.0),)
    return kept(row, "spheres", lambda value: tuple((float(size), float(share)) for size, share in value))


def calibration_report(aggregate: Aggregate, row: Calibration) -> CalibrationReport:
    """Return a stored calibration as the report it gave."""
    return CalibrationReport(
        aggregate=aggregate.name,
        aggregate_id=aggregate.id,
        calibration_id=row.id,
        method=row.method,
        diameter=row.diameter_mm,
        rule=row.diameter_rule,
        sizes=spheres_of(row),
        measured=_measured(row, aggregate),
        angle=row.measured_angle_deg,
        wall=row.wall_friction,
        compaction=row.packing_test.compaction if row.packing_test else "",
        protocol=protocol_kept(row),
        friction=float(row.friction or 0.0),
        rolling=float(row.rolling_friction or 0.0),
        result=_result(row) if row.state == "done" else None,
        density=particle_density(aggregate),
    )
