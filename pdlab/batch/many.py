"""Predictions of a table of any length: read in slices, equal beds run once, rows told as they come.

What is asked for, and what came of it, stands in the store: a table that was stopped is begun again and asks for the
rest. Memory holds a slice and what is under way.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from pdlab import experiments, store
from pdlab.batch.driving import Work
from pdlab.batch.runner import Runner
from pdlab.batch.working import Claims, answer_claims
from pdlab.errors import PdlabError
from pdlab.experiments import PredictionReport, Report, Way
from pdlab.plan import Plan
from pdlab.store import Key
from pdlab.tables import Slice, Slices


@dataclass(frozen=True)
class Told:
    """A row that is told: the mixture's number in its table, counted from 0, and its report or error.

    ``fresh``: it was worked out now; else it was read, or could not be asked for.
    """

    number: int
    report: PredictionReport
    fresh: bool


class _Table(Claims):
    """The works of a table: slice by slice its mixtures are registered, read where they are known, else wished for."""

    def __init__(self, runner: Runner, table: Slices, way: Way) -> None:
        super().__init__(runner, ())
        self._slices, self._begun, self._way = iter(table), 0, way
        self._part: Slice | None = None
        self.numbers = dict[Key, list[tuple[int, str]]]()

    def __next__(self) -> Work[Report] | None:
        if not self._ready and not self.left:
            self._part = self._part or next(self._slices, None)
            if self._part is not None:
                self._ask(self._part)  # once more where the store was away
                self._part = None
        return super().__next__()

    def _ask(self, part: Slice) -> None:
        reports, ids = _registered(self._runner, part, self._way)
        with self._runner.target.read() as session:
            rows = store.mixtures_by_id(session, list(set(ids.values())))
        asked = experiments.ask_predictions(self._runner.target, rows, self._way, self._runner.engine_version)
        self.own |= dict.fromkeys(asked.own)
        for place, brought in enumerate(part.mixtures):
            number = self._begun + place
            if place in reports:
                self._tell(number, reports[place])
            elif ids[place] in asked.reports:
                self._tell(number, asked.reports[ids[place]])
            else:
                key = asked.wishes[ids[place]]
                self.left[key] = None
                self.numbers.setdefault(key, []).append((number, brought.name))
        self._begun += len(part.mixtures)

    def _tell(self, number: int, report: PredictionReport) -> None:
        self._ready.append(Work(number, lambda: _known(report)))


def _known(report: PredictionReport) -> Plan[Report]:
    """Return a plan that asks for nothing and has its result."""
    return report
    yield


def _registered(runner: Runner, part: Slice, way: Way) -> tuple[dict[int, PredictionReport], dict[int, int]]:
    """Register a slice; return, by place, the reports of what cannot be, and the ids of the others."""
    reports, ids = dict[int, PredictionReport](), dict[int, int]()
    for place, found in enumerate(experiments.register_each(runner.target, part)):
        if isinstance(found, int):
            ids[place] = found
        else:
            reports[place] = _failed(part.mixtures[place].name, way, found)
    return reports, ids


def _failed(mixture: str, way: Way, error: PdlabError) -> PredictionReport:
    text = "; ".join(str(error).splitlines())
    return PredictionReport(mixture, way.method, state="failed", notes=(text,), error=error)


def predict_table(runner: Runner, table: Slices, way: Way) -> Iterator[Told]:
    """Predict every mixture of a table; yield each as it comes, those that the store knows at once.

    Raises TableError where the table cannot be read any longer, WorkersLost, StoreError.
    """
    works = _Table(runner, table, way)
    for key, report in answer_claims(runner, works):
        if isinstance(key, int):
            assert isinstance(report, PredictionReport)
            yield Told(key, report, fresh=False)
            continue
        for number, name in works.numbers.pop(key):
            if isinstance(report, PdlabError):
                yield Told(number, _failed(name, way, report), fresh=True)
            else:
                assert isinstance(report, PredictionReport)
                yield Told(number, report, fresh=True)


def told_in_order(runner: Runner, table: Slices, way: Way, failed: dict[int, str]) -> Iterator[PredictionReport]:
    """Yield the reports of a table that has been predicted, in its order, with the errors to expect of all of it.

    ``failed``: by number, why there is no prediction.
    """
    begun = 0
    for part in table:
        reports, ids = _registered(runner, part, way)
        with runner.target.read() as session:
            rows = store.mixtures_by_id(session, list(set(ids.values())))
        found = experiments.answered(runner.target, rows, way, runner.engine_version)
        for place, brought in enumerate(part.mixtures):
            if place in reports:
                yield reports[place]
            elif ids[place] in found:
                yield found[ids[place]]
            else:
                why = failed.get(begun + place, "its prediction has gone from the store meanwhile; run the batch again")
                yield _failed(brought.name, way, PdlabError(why))
        begun += len(part.mixtures)
