"""Predictions of a table of any length: read in slices, equal beds run once, rows told as they come.

What is asked for, and what came of it, stands in the store: a table that was stopped is begun again and asks for the
rest. Memory holds a slice and what is under way; of each mixture that is to be predicted some bytes.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from pdlab import experiments, packing, planning, store
from pdlab.batch.driving import Work
from pdlab.batch.runner import Runner
from pdlab.batch.working import Claims, answer_claims
from pdlab.errors import PdlabError
from pdlab.experiments import PredictionReport, Report, Way
from pdlab.models import Mixture
from pdlab.plan import Plan
from pdlab.planning import Estimate
from pdlab.store import Key, Store
from pdlab.tables import Slice, Slices


@dataclass
class Summary:
    """What became of a table: how many of its mixtures were predicted now, read, or could not be; what was run.

    ``runs`` and ``sphere_steps`` simulated, in ``seconds`` [s] by the clock.
    """

    mixtures: int
    predicted: int = 0
    read: int = 0
    failed: int = 0
    runs: int = 0
    sphere_steps: int = 0
    seconds: float = 0.0

    def count(self, told: "Told") -> None:
        """Count a row."""
        if told.report.error is not None:
            self.failed += 1
        elif told.fresh:
            self.predicted += 1
        else:
            self.read += 1


@dataclass(frozen=True)
class Told:
    """A row that is told: the mixture's number in its table, counted from 0, and its report.

    ``fresh``: it was worked out now; else it was read, or could not be asked for.
    """

    number: int
    report: PredictionReport
    fresh: bool = False


@dataclass
class Survey:
    """What is known of a table before anything is run.

    ``pending``, shape (M,): whether a mixture is still to be predicted; ``read`` and ``failed``: how many were read,
    and how many cannot be asked for.
    """

    runner: Runner
    pending: np.ndarray
    read: int = 0
    failed: int = 0
    _estimates: list[Estimate] = field(default_factory=list)
    _new: set[str] = field(default_factory=set)

    @cached_property
    def _model(self) -> planning.Model:
        here = packing.fingerprint()["cpu"]
        return planning.learn(experiments.known_runs(self.runner.target, self.runner.engine_version, here))

    def add(self, target: Store, rows: list[Mixture], way: Way) -> None:
        """Take in mixtures that are to be predicted: the beds that they will take and no other before them."""
        beds = experiments.beds_to_run(target, rows, way, self.runner.engine_version)
        new = {bed.digest(self.runner.engine_version): bed for bed in beds}
        fresh = [bed for digest, bed in new.items() if digest not in self._new]
        self._new |= new.keys()
        self._estimates.append(planning.estimate(fresh, self._model))

    @property
    def estimate(self) -> Estimate:
        """What the runs will cost that are new."""
        return planning.joined(self._estimates or [planning.estimate([], self._model)])


def survey(runner: Runner, table: Slices, way: Way, rehearse: bool = False) -> Iterator[Told | Survey]:
    """Go through a table: yield what is known of its rows, and in the end the survey of the others.

    ``rehearse``: nothing is written, mixtures that are new neither. Raises TableError where the table cannot be read
    any longer, StoreError.
    """
    found, begun = Survey(runner, np.zeros(table.count, dtype=bool)), 0
    for part in table:
        yield from runner.patiently(partial(_look, found, part, begun, way, rehearse))
        begun += len(part.mixtures)
    yield found


def _look(found: Survey, part: Slice, begun: int, way: Way, rehearse: bool) -> list[Told]:
    if rehearse:
        with found.runner.target.rehearsal() as target:
            return _look_into(found, target, part, begun, way)
    return _look_into(found, found.runner.target, part, begun, way)


def _look_into(found: Survey, target: Store, part: Slice, begun: int, way: Way) -> list[Told]:
    failed, rows = _registered(target, part, way)
    known = experiments.answered(target, list(rows.values()), way, found.runner.engine_version)
    open_ones = {place: row for place, row in rows.items() if row.id not in known}
    if open_ones:
        found.add(target, list(open_ones.values()), way)
    found.read += len(rows) - len(open_ones)
    found.failed += len(failed)
    found.pending[[begun + place for place in open_ones]] = True
    told = failed | {place: known[row.id] for place, row in rows.items() if row.id in known}
    return [Told(begun + place, told[place]) for place in sorted(told)]


def _registered(target: Store, part: Slice, way: Way) -> tuple[dict[int, PredictionReport], dict[int, Mixture]]:
    """Register a slice; return, by place, the reports of what cannot be, and the rows of the others."""
    reports, ids = dict[int, PredictionReport](), dict[int, int]()
    for place, found in enumerate(experiments.register_each(target, part)):
        if isinstance(found, int):
            ids[place] = found
        else:
            reports[place] = _failed(part.mixtures[place].name, way, found)
    with target.read() as session:
        rows = {row.id: row for row in store.mixtures_by_id(session, list(set(ids.values())))}
    return reports, {place: rows[key] for place, key in ids.items()}


def _failed(mixture: str, way: Way, error: PdlabError) -> PredictionReport:
    text = "; ".join(str(error).splitlines())
    return PredictionReport(mixture, way.method, state="failed", notes=(text,), error=error)


class _Table(Claims):
    """The wishes of a table: slice by slice, as they are needed, those of its pending mixtures."""

    def __init__(self, runner: Runner, table: Slices, pending: np.ndarray, way: Way) -> None:
        super().__init__(runner, ())
        self._slices, self._begun = iter(table), 0
        self._part: Slice | None = None
        self._pending, self._way = pending, way
        self.numbers = dict[Key, tuple[int, str]]()

    def __next__(self) -> Work[Report] | None:
        while not self._ready and not self.left:
            self._part = self._part or next(self._slices, None)
            if self._part is None:
                break
            self._ask(self._part)  # once more where the store was away
            self._begun += len(self._part.mixtures)
            self._part = None
        return super().__next__()

    def _ask(self, part: Slice) -> None:
        if not self._pending[self._begun : self._begun + len(part.mixtures)].any():
            return
        _, rows = _registered(self._runner.target, part, self._way)
        wanted = {place: row for place, row in rows.items() if self._pending[self._begun + place]}
        asked = experiments.ask_predictions(
            self._runner.target, list(wanted.values()), self._way, self._runner.engine_version
        )
        for place, row in wanted.items():
            number = self._begun + place
            if row.id in asked.reports:  # another has asked meanwhile
                self._ready.append(Work(number, partial(_known, asked.reports[row.id])))
            else:
                key = asked.wishes[row.id]
                self.left[key], self.numbers[key] = None, (number, row.name)
        self.own |= dict.fromkeys(asked.own)


def _known(report: PredictionReport) -> Plan[Report]:
    """Return a plan that asks for nothing and has its result."""
    return report
    yield


def predict_pending(runner: Runner, table: Slices, pending: np.ndarray, way: Way) -> Iterator[Told]:
    """Predict the mixtures of a table that are pending; yield each as it comes.

    ``pending``, shape (M,): of a ``survey``. Raises TableError where the table cannot be read any longer,
    WorkersLost, StoreError.
    """
    works = _Table(runner, table, pending, way)
    for key, report in answer_claims(runner, works):
        if isinstance(key, int):
            assert isinstance(report, PredictionReport)
            yield Told(key, report)
            continue
        number, name = works.numbers.pop(key)
        said = _failed(name, way, report) if isinstance(report, PdlabError) else report
        assert isinstance(said, PredictionReport)
        yield Told(number, said, fresh=True)


def predict_table(
    runner: Runner, table: Slices, way: Way, on_survey: Callable[[Survey], None] | None = None
) -> Iterator[Told]:
    """Predict every mixture of a table: first what is known, then, after its survey, the others as they come.

    Raises as ``survey`` and ``predict_pending`` do.
    """
    for told in survey(runner, table, way):
        if isinstance(told, Told):
            yield told
            continue
        if on_survey is not None:
            on_survey(told)
        if told.pending.any():
            yield from predict_pending(runner, table, told.pending, way)


def in_order(
    runner: Runner, table: Slices, way: Way, failed: Mapping[int, PredictionReport]
) -> Iterator[PredictionReport]:
    """Yield the reports of a table that has been predicted, in its order, with the errors to expect of all of it.

    ``failed``: by number, those of which there is no prediction.
    """
    begun = 0
    for part in table:
        told = runner.patiently(partial(_look_again, runner, part, way))
        for place, brought in enumerate(part.mixtures):
            report = told.get(place) or failed.get(begun + place)
            gone = PdlabError("its prediction is gone from the store; run it again")
            yield report or _failed(brought.name, way, gone)
        begun += len(part.mixtures)


def _look_again(runner: Runner, part: Slice, way: Way) -> dict[int, PredictionReport]:
    failed, rows = _registered(runner.target, part, way)
    known = experiments.answered(runner.target, list(rows.values()), way, runner.engine_version)
    return failed | {place: known[row.id] for place, row in rows.items() if row.id in known}
