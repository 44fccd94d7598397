"""Calibrate aggregates: the runs they share, the curve, the rows that keep it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pdlab import calibration, grading, store
from pdlab.calibration import METHOD
from pdlab.density import MeasuredPacking
from pdlab.errors import EngineError, InputError, PdlabError
from pdlab.experiments.readings import current_grading, measured_test, particle_density, protocol_text
from pdlab.grading import DEFAULT_RULE
from pdlab.models import Aggregate, Calibration, CalibrationRun, PackingTest, SieveAnalysis, now
from pdlab.specimen import Packing, Protocol, Specimen, protocol_of
from pdlab.store import Store

RunAll = Callable[[Sequence[Specimen]], list[Packing | EngineError]]
"""Runs specimens, or reads those already run; returns in the same order what each gave."""


LEAST_SEEDS = 2
"""Beds that a standard error needs."""


@dataclass(frozen=True)
class CalibrationReport:
    """An aggregate's calibration, or the error that stands in its place."""

    aggregate: str
    aggregate_id: int
    calibration_id: int | None = None
    diameter: float = math.nan
    rule: str = DEFAULT_RULE
    measured: float = math.nan
    compaction: str = ""
    result: calibration.Calibrated | None = None
    density: float | None = None
    error: PdlabError | None = None


@dataclass
class _Open:
    """An aggregate on its way to a calibration."""

    aggregate: Aggregate
    analysis: SieveAnalysis
    test: PackingTest
    measured: MeasuredPacking
    diameter: float
    warnings: list[str]
    nodes: dict[float, list[Packing]] = field(default_factory=dict)
    error: EngineError | None = None

    @property
    def protocol(self) -> Protocol:
        """How its test is simulated."""
        return protocol_of(self.test.compaction)

    def missing_nodes(self) -> set[float]:
        """Return the nodes that its own curve still needs."""
        if self.error is not None:
            return set()
        return calibration.missing_nodes(self.measured, calibration.curve(self.nodes) if self.nodes else None)

    def add(self, node: float, outcomes: Sequence[Packing | EngineError]) -> None:
        """Take a node's runs into its curve, or the first error of one."""
        self.nodes[node] = [outcome for outcome in outcomes if isinstance(outcome, Packing)]
        self.error = self.error or next((out for out in outcomes if isinstance(out, EngineError)), None)


def calibrate(
    target: Store,
    run_all: RunAll,
    names: Sequence[str] = (),
    rule: str = DEFAULT_RULE,
    seeds: int = calibration.SEEDS,
) -> list[CalibrationReport]:
    """Calibrate the named aggregates, or all; each one's error stands in its report.

    Runs are shared: the nodes of the curve PD(μ) that any aggregate needs are run once for all. Raises
    UnknownName, and InputError for an unknown ``rule`` or fewer than two ``seeds``.
    """
    with target.read() as session:
        rows = store.aggregates(session, names)
    if not rows:
        raise InputError("the store holds no aggregate yet; import some, or run 'pdlab demo'")
    return calibrate_rows(target, run_all, rows, rule, seeds)


def calibrate_rows(
    target: Store, run_all: RunAll, rows: Sequence[Aggregate], rule: str, seeds: int
) -> list[CalibrationReport]:
    """Calibrate aggregates as ``calibrate`` does, each in the delivery that is handed in."""
    if rule not in grading.RULES:
        raise InputError(f"'{rule}' is no diameter rule; use one of {', '.join(grading.RULES)}")
    if seeds < LEAST_SEEDS:
        raise InputError(f"{seeds} seeds give no standard error; use at least {LEAST_SEEDS}")
    reports, waiting = dict[int, CalibrationReport](), dict[int, _Open]()
    for row in rows:
        try:
            waiting[row.id] = _open_calibration(row, rule)
        except PdlabError as error:
            reports[row.id] = CalibrationReport(row.name, row.id, error=error)
    _fill_curves(list(waiting.values()), run_all, seeds)
    for key, one in waiting.items():
        try:
            if one.error is not None:
                raise one.error
            result = calibration.solve(one.measured, calibration.curve(one.nodes))
            reports[key] = _save_calibration(target, one, rule, _facts_of(one, result))
        except PdlabError as error:
            _save_calibration(target, one, rule, {"state": "failed", "message": str(error)})
            reports[key] = CalibrationReport(one.aggregate.name, key, error=error)
    return [reports[row.id] for row in rows]


def _open_calibration(row: Aggregate, rule: str) -> _Open:
    sieved, test = current_grading(row), store.newest_test(row.packing_tests)
    if sieved is None:
        raise InputError(f"aggregate '{row.name}' has no sieve analysis; enter one")
    if test is None:
        raise InputError(f"aggregate '{row.name}' has no density test; enter one")
    warnings = list(sieved.warnings)
    if test.compaction == "unstated":
        warnings.append("the density test's compaction is not stated: it is simulated as loose")
    measured = measured_test(test, particle_density(row))
    coarsest = sieved.apertures[0]
    if test.container_diameter_mm is not None and test.container_diameter_mm < 10.0 * coarsest:
        warnings.append(
            f"the container is {test.container_diameter_mm / coarsest:.3g} of the largest size wide, less than 10: "
            "the wall's effect on the measured PD lies in the friction coefficient"
        )
    diameter = grading.equivalent_diameter(sieved, rule)
    return _Open(row, row.sieve_analyses[-1], test, measured, diameter, [*warnings, *measured.warnings])


def _fill_curves(waiting: list[_Open], run_all: RunAll, seeds: int) -> None:
    """Run nodes, round by round, until every aggregate's PD is enclosed or out of reach.

    A node is run once for all, but each aggregate's curve holds the nodes that it asked for itself: its
    friction does not depend on who was calibrated beside it.
    """
    shared: dict[tuple[Protocol, float], list[Packing | EngineError]] = {}
    while True:
        asked = [(one, node) for one in waiting for node in one.missing_nodes()]
        wanted = sorted({(one.protocol, node) for one, node in asked} - set(shared), key=str)
        beds = [bed for protocol, node in wanted for bed in calibration.node_specimens(node, seeds, protocol)]
        outcomes = run_all(beds)
        shared |= {key: outcomes[k * seeds : (k + 1) * seeds] for k, key in enumerate(wanted)}
        for one, node in asked:
            one.add(node, shared[one.protocol, node])
        if not asked:
            return


def _facts_of(one: _Open, result: calibration.Calibrated) -> dict[str, Any]:
    return {
        "state": "done",
        "message": None,
        "friction": result.friction,
        "friction_low": result.low,
        "friction_high": result.high,
        "packing_density": result.packing_density,
        "input_error": result.input_error,
        "curve_error": result.curve_error,
        "warnings": "\n".join([*one.warnings, *result.warnings]) or None,
    }


def _save_calibration(target: Store, one: _Open, rule: str, outcome: dict[str, Any]) -> CalibrationReport:
    """Write a calibration, or why there is none; of an equal one on the same runs only the time is renewed."""
    packings = [packing for node in one.nodes.values() for packing in node]
    digests = {packing.digest for packing in packings}
    facts: dict[str, Any] = outcome | {
        "aggregate_id": one.aggregate.id,
        "sieve_analysis_id": one.analysis.id,
        "packing_test_id": one.test.id,
        "method": METHOD,
        "protocol": protocol_text(one.protocol),
        "engine_version": packings[0].engine_version if packings else None,
        "diameter_rule": rule,
        "diameter_mm": one.diameter,
        "measured_packing_density": one.measured.packing_density,
    }
    with target.write() as session:
        row = next(iter(store.equal_results(session, Calibration, facts, digests)), None)
        if row is None:
            evidence = [CalibrationRun(specimen_hash=digest) for digest in sorted(digests)]
            row = Calibration(progress=1.0, finished_at=now(), runs=evidence, **facts)
            store.add_all(session, [row])
        row.requested_at = now()
        return calibration_report(one.aggregate, row)


def calibration_report(aggregate: Aggregate, row: Calibration) -> CalibrationReport:
    """Return a stored calibration that is done as the report it gave."""
    result = calibration.Calibrated(
        friction=float(row.friction or 0.0),
        low=row.friction_low,
        high=row.friction_high,
        packing_density=float(row.packing_density or 0.0),
        input_error=float(row.input_error or 0.0),
        curve_error=float(row.curve_error or 0.0),
        warnings=tuple((row.warnings or "").splitlines()),
    )
    measured = math.nan if row.measured_packing_density is None else row.measured_packing_density
    return CalibrationReport(
        aggregate.name, aggregate.id, row.id, row.diameter_mm, row.diameter_rule, measured,
        row.packing_test.compaction if row.packing_test else "", result, particle_density(aggregate),
    )  # fmt: skip
