"""Answering wishes: a runner claims them and carries on their plans; what others have answered is read."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

from pdlab import experiments, store
from pdlab.batch.driving import Work
from pdlab.batch.names import is_gone
from pdlab.batch.runner import Runner
from pdlab.errors import ClaimLost, PdlabError
from pdlab.experiments import Asked, CalibrationReport, PredictionReport, Report, Way
from pdlab.plan import Plan
from pdlab.store import Key

log = logging.getLogger(__name__)

R = TypeVar("R", CalibrationReport, PredictionReport)


class Claims:
    """The wishes that a runner claims, one after the other: of these keys, or of all that there are and will be.

    A wish that another runner has answered, or somebody cancelled, is told as the store has it. ``own``: those that
    are to be cancelled when the work on them is stopped.
    """

    def __init__(self, runner: Runner, keys: Sequence[Key] | None, own: Sequence[Key] = ()) -> None:
        self._runner, self._all = runner, keys is None
        self.left, self.own = dict.fromkeys(keys or ()), dict.fromkeys(own)
        self._ready = list[Work[Report]]()

    def __iter__(self) -> "Claims":
        return self

    def __next__(self) -> Work[Report] | None:
        if not self._ready and (self._all or self.left):
            self._ready = self._claim() or self._told()
        if self._ready:
            return self._ready.pop(0)
        if self._all or self.left:
            return None
        raise StopIteration

    def _claim(self) -> list[Work[Report]]:
        runner, ids = self._runner, dict[str, list[int]]()
        for kind, key in self.left:
            ids.setdefault(kind, []).append(key)
        with runner.target.write() as session:
            most = 2 * runner.pool.workers
            keys = store.claim_wishes(session, runner.who, most, is_gone, None if self._all else ids)
        return [self._work(key) for key in keys]

    def _work(self, key: Key) -> Work[Report]:
        self.left.pop(key, None)
        runner = self._runner
        return Work(
            key, lambda: experiments.answering(runner.target, key, runner.who, runner.engine_version), claimed=True
        )

    def _told(self) -> list[Work[Report]]:
        """Return works that only read, for wishes that have ended by others' hands."""
        with self._runner.target.read() as session:
            states = store.wish_states(session, list(self.left))
        ended = [key for key in self.left if states.get(key, "deleted") not in store.WAITING]
        for key in ended:
            del self.left[key]
        return [Work(key, lambda key=key: self._reading(key)) for key in ended]  # type: ignore[misc]

    def _reading(self, key: Key) -> Plan[Report]:
        return experiments.report_on(self._runner.target, key)
        yield  # a plan that asks for nothing


def answer(runner: Runner, keys: Sequence[Key], own: Sequence[Key] = ()) -> Iterator[tuple[Key, Report | PdlabError]]:
    """Answer wishes, with the other runners of the store; yield what each gave as it ends.

    ``own``: those that are to be cancelled when this is stopped. Raises WorkersLost, StoreError.
    """
    yield from answer_claims(runner, Claims(runner, keys, own))


def answer_claims(runner: Runner, claims: Claims) -> Iterator[tuple[Any, Report | PdlabError]]:
    """Answer the wishes of ``claims`` as ``answer`` does."""
    try:
        while True:
            for key, report in runner.drive(claims):
                if isinstance(report, ClaimLost):  # what became of it is told, or waited for
                    claims.left[key] = None
                    continue
                claims.own.pop(key, None)
                yield key, report
            if not claims.left:
                return
    except BaseException:
        _let_go(runner, list(claims.own))
        raise


def calibrate(runner: Runner, names: Sequence[str], way: Way) -> list[CalibrationReport]:
    """Calibrate the named aggregates, or all; each one's error stands in its report. Raises UnknownName, InputError."""
    rows = experiments.to_calibrate(runner.target, names, way)
    asked = experiments.ask_calibrations(runner.target, rows, way, runner.engine_version)
    found = dict(asked.reports) | _answered(
        runner, asked, {row.id: CalibrationReport(row.name, row.id) for row in rows}
    )
    return [found[row.id] for row in rows]


def predict(runner: Runner, names: Sequence[str], way: Way) -> list[PredictionReport]:
    """Predict the named mixtures, or all; each one's error stands in its report. Raises UnknownName, InputError."""
    rows = experiments.to_predict(runner.target, names)
    asked = experiments.ask_predictions(runner.target, rows, way, runner.engine_version)
    blank = {row.id: PredictionReport(row.name, way.method, state="failed") for row in rows}
    found = dict(asked.reports) | _answered(runner, asked, blank)
    if asked.wishes:  # the errors to expect are of all that is known by now
        found |= experiments.answered(runner.target, rows, way, runner.engine_version)
    return [found[row.id] for row in rows]


def _answered(runner: Runner, asked: Asked[R], blank: Mapping[int, R]) -> dict[int, R]:
    """Answer all that was asked for; an error stands in a blank report."""
    ids, out = {wish: key for key, wish in asked.wishes.items()}, dict[int, R]()
    for wish, report in answer(runner, list(ids), asked.own):
        key = ids[wish]
        out[key] = replace(blank[key], error=report) if isinstance(report, PdlabError) else cast("R", report)
    return out


def serve(runner: Runner) -> None:
    """Answer whatever is wished for until this is stopped; what is then under way is left to the next runner."""
    try:
        for key, report in runner.drive(Claims(runner, None)):
            kind, row_id = key
            error = report if isinstance(report, PdlabError) else report.error
            log.info("%s %d: %s", kind, row_id, error or "done")
    finally:
        _let_go(runner, [])


def _let_go(runner: Runner, cancelled: Sequence[Key]) -> None:
    try:
        if cancelled:
            experiments.cancel(runner.target, cancelled, "stopped before it was done; ask again")
        with runner.target.write() as session:
            store.release(session, runner.who)
    except PdlabError as error:  # the leases will end by themselves
        log.warning("%s", error)
