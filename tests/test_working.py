"""Wishes: asked, claimed, answered once, whoever asks and whoever works."""

import datetime as dt
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import FormulaPool, ThreadsPool, both

from pdlab import experiments, packing
from pdlab import store as store_room
from pdlab.batch import chunks, driving, interrupts, jobs
from pdlab.batch.driving import Work
from pdlab.batch.names import is_gone, own_name
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer, calibrate, predict, serve
from pdlab.cli.shell import end_as_by_ctrl_c
from pdlab.errors import ClaimLost, PdlabError, StoreAway
from pdlab.experiments import Way, ask_predictions, register
from pdlab.lab import SHIPPED
from pdlab.models import Calibration, Prediction, Run, RunState, now
from pdlab.plan import Plan
from pdlab.specimen import Packing, Species, Specimen, with_seeds
from pdlab.store import LEASE, Store
from pdlab.tables import read_path

SMALL = Specimen((Species(1.0, 0.3, 100),), 4.0, 1)


@pytest.fixture
def filled(opened: Store) -> Store:
    register(opened, read_path(SHIPPED))
    return opened


def rows(target: Store, table: Any) -> list[Any]:
    with target.read() as session:
        return list(session.scalars(sa.select(table)))


def wishes(target: Store) -> list[tuple[str, int]]:
    blends = experiments.to_predict(target, ())
    return list(ask_predictions(target, blends, Way(), packing.VERSION).wishes.values())


class Counting(FormulaPool):
    """Notes every bed that is run."""

    def __init__(self) -> None:
        self.run = list[str]()

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        self.run.append(specimen.digest(packing.VERSION))
        return super().submit(specimen, state, steps, threads)


@both
def test_what_is_asked_is_answered_once_and_then_read_without_a_wish(filled: Store) -> None:
    runner = Runner(filled, Counting())
    first = predict(runner, (), Way())
    assert [report.state for report in first] == ["done"] * 3
    assert len(runner.pool.run) == len(set(runner.pool.run)) == runner.simulated > 0
    assert {row.state for row in rows(filled, Prediction)} == {"done"}
    before = len(rows(filled, Prediction)), len(rows(filled, Calibration)), runner.simulated
    assert predict(runner, (), Way()) == first
    assert (len(rows(filled, Prediction)), len(rows(filled, Calibration)), runner.simulated) == before
    calibrated = calibrate(runner, (), Way())
    assert [report.error for report in calibrated] == [None] * 3
    assert len(rows(filled, Calibration)) == before[1]


def test_a_calibration_that_needs_beds_is_a_wish_and_its_row_holds_the_result(filled: Store) -> None:
    runner = Runner(filled, FormulaPool())
    reports = calibrate(runner, (), Way())
    kept = {row.id: row for row in rows(filled, Calibration)}
    assert len(kept) == 3
    for report in reports:
        assert report.result is not None
        assert report.calibration_id is not None
        row = kept[report.calibration_id]
        assert (row.state, row.friction, row.claimed_by) == ("done", report.result.value, runner.who)
        assert row.asked == Way().text()


@both
def test_two_runners_share_wishes_and_no_bed_is_run_twice(filled: Store) -> None:
    keys = wishes(filled)
    pools = [Counting(), Counting()]
    found: list[dict[Any, Any]] = [{}, {}]

    def work(k: int) -> None:
        for key, report in answer(Runner(filled, pools[k]), keys):
            found[k][key] = report

    workers = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    both_ran = pools[0].run + pools[1].run
    assert len(both_ran) == len(set(both_ran))
    assert len(rows(filled, Prediction)) == 3
    for one in found:
        assert one.keys() == set(keys)
        assert all(report.state == "done" for report in one.values())
    densities = [{key: report.packing_density for key, report in one.items()} for one in found]
    assert densities[0] == densities[1]


@both
def test_a_lease_keeps_others_off_until_it_ends(filled: Store) -> None:
    keys = wishes(filled)

    def claim(who: str, gone: Callable[[str], bool] = lambda _: False) -> list[Any]:
        with filled.write() as session:
            return store_room.claim_wishes(session, who, 10, gone)

    assert claim("first") == keys
    assert claim("second") == []
    with filled.write() as session:
        session.execute(sa.update(Prediction).values(heartbeat=now() - dt.timedelta(seconds=LEASE + 1)))
    assert claim("second") == keys
    with filled.write() as session:
        assert store_room.beat(session, "first", dict.fromkeys(keys, 0.5)) == set()
        assert store_room.beat(session, "second", dict.fromkeys(keys, 0.5)) == set(keys)
    assert {row.progress for row in rows(filled, Prediction)} == {0.5}
    with filled.write() as session:
        session.execute(sa.update(Prediction).values(heartbeat=now() - dt.timedelta(seconds=LEASE - 1)))
        assert store_room.beat(session, "second", {}) == set(keys), "also those that have not begun"
    assert all(now() - row.heartbeat < dt.timedelta(seconds=LEASE / 2) for row in rows(filled, Prediction))
    assert claim("third") == []
    assert claim("third", lambda name: name == "second") == keys, "who is known to have ended holds nothing"


def test_wishes_are_taken_by_priority_and_then_by_age(filled: Store) -> None:
    keys = wishes(filled)
    with filled.write() as session:
        session.execute(sa.update(Prediction).where(Prediction.id == keys[2][1]).values(priority=5))
        assert store_room.claim_wishes(session, "one", 2, lambda _: False) == [keys[2], keys[0]]


def test_a_wish_that_waits_is_not_asked_twice(filled: Store) -> None:
    assert wishes(filled) == wishes(filled)
    assert len(rows(filled, Prediction)) == 3


def test_a_result_is_not_written_into_a_wish_that_was_cancelled_or_taken_over(filled: Store) -> None:
    keys = wishes(filled)
    runner = Runner(filled, FormulaPool())
    with filled.write() as session:
        store_room.claim_wishes(session, runner.who, 10, is_gone)
    experiments.cancel(filled, keys[:1])
    with filled.write() as session:
        session.execute(sa.update(Prediction).where(Prediction.id == keys[1][1]).values(claimed_by="another"))
    works = [
        Work(key, lambda key=key: experiments.answering(filled, key, runner.who, packing.VERSION), claimed=True)
        for key in keys
    ]
    outcomes = dict(runner.drive(works))
    assert isinstance(outcomes[keys[0]], ClaimLost)
    assert isinstance(outcomes[keys[1]], ClaimLost)
    assert outcomes[keys[2]].state == "done"
    states = {row.id: row.state for row in rows(filled, Prediction)}
    assert states == {keys[0][1]: "cancelled", keys[1][1]: "running", keys[2][1]: "done"}


class Endless(ThreadsPool):
    """Beds that never rest."""

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        return self._executor.submit(lambda: chunks.Advanced(packing.Progress(1, 1.0, 1.0, 0.5), 0.0, "a b", ANY_STATE))


ANY_STATE = packing.advance(SMALL, None, 1)


def test_a_wish_that_is_cancelled_while_it_runs_ends_within_a_heartbeat(
    filled: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driving, "BEAT", 0.1)
    keys = wishes(filled)
    runner = Runner(filled, Endless())
    ended = list[Any]()

    def cancel_soon(_: Any) -> None:
        if runner.on_progress is not None:
            runner.on_progress = None
            experiments.cancel(filled, keys)

    runner.on_progress = cancel_soon
    for key, report in answer(runner, keys):
        ended.append(key)
        assert isinstance(report, experiments.PredictionReport)
        assert report.state == "cancelled"
        assert report.error is not None
    assert sorted(ended) == sorted(keys)
    assert rows(filled, Run) == [], "runs that nobody waits for leave no claim"


def test_stopping_cancels_what_was_asked_and_frees_what_was_claimed(filled: Store) -> None:
    blends = experiments.to_predict(filled, ())
    asked = ask_predictions(filled, blends, Way(), packing.VERSION)

    def stop(_: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(answer(Runner(filled, Endless(), stop), list(asked.wishes.values()), asked.own))
    assert {row.state for row in rows(filled, Prediction)} == {"cancelled"}
    assert {row.message for row in rows(filled, Prediction)} == {"stopped before it was done; ask again"}
    assert rows(filled, Run) == []
    assert [report.state for report in predict(Runner(filled, FormulaPool()), (), Way())] == ["done"] * 3


def test_a_runner_that_is_stopped_leaves_its_wishes_to_the_next(filled: Store) -> None:
    wishes(filled)

    def stop(_: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        serve(Runner(filled, Endless(), stop))
    assert {row.state for row in rows(filled, Prediction)} == {"queued"}


class Signals:
    """Raises a signal when it is deleted, whose exception Python drops."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_python_drops_stops_a_runner_all_the_same(number: signal.Signals, filled: Store) -> None:
    before = {one: signal.getsignal(one) for one in interrupts.SIGNALS}
    wishes(filled)
    end_as_by_ctrl_c()
    left, told = [Signals(number)], list[int]()

    def drop(_: object) -> None:
        left.clear()
        told.append(1)
        assert len(told) < 20, "it goes on"

    try:
        with pytest.raises(KeyboardInterrupt):
            serve(Runner(filled, Endless(), drop))
        heard = signal.getsignal(number)
        assert heard is (before[number] if number == signal.SIGINT else signal.SIG_IGN), "none comes while all ends"
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert {row.state for row in rows(filled, Prediction)} == {"queued"}


def test_a_wish_for_what_cannot_be_says_why_in_its_row(filled: Store) -> None:
    with filled.write() as session:
        session.execute(sa.text("UPDATE packing_test SET compaction = 'rodded' WHERE id = 1"))
    reports = predict(Runner(filled, FormulaPool()), (), Way())
    failed = [report for report in reports if report.error is not None]
    assert failed
    kept = {row.id: row for row in rows(filled, Prediction)}
    for report in failed:
        assert report.prediction_id is not None
        row = kept[report.prediction_id]
        assert (row.state, row.message) == ("failed", str(report.error))
        assert "need one compaction" in str(report.error) or "needs one compaction" in str(report.error)


def test_a_bed_is_kept_while_it_is_under_way_and_goes_on_from_there_to_the_same_bytes(
    opened: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "CHUNK", 60_000)
    monkeypatch.setattr(driving, "CHECKPOINT", 0.0)
    whole = packing.measure(SMALL, packing.advance(SMALL, None, 10**9), 0.0)
    seen = list[int]()

    def stop(progress: Any) -> None:
        seen.extend(bed.steps for bed in progress.beds)
        if len(seen) > 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Runner(opened, ThreadsPool(), stop)([SMALL])
    (run,) = rows(opened, Run)
    (bed,) = rows(opened, RunState)
    assert (run.state, run.claimed_by) == ("queued", None)
    with opened.write() as session:
        session.execute(sa.update(Run).values(seconds=1000.0))
    assert bed.steps == run_steps(seen, bed.steps)
    first = list[int]()
    (result,) = Runner(opened, ThreadsPool(), lambda told: first.extend(bed.steps for bed in told.beds))([SMALL])
    assert isinstance(result, Packing)
    assert min(first) >= bed.steps, "it began anew"
    assert result.packing_density == whole.packing_density
    assert result.steps == whole.steps
    (run,) = rows(opened, Run)
    assert (run.state, run.packing_density, run.steps) == ("done", whole.packing_density, whole.steps)
    assert run.seconds == result.seconds > 1000.0, "what was spent before counts"
    (bed,) = rows(opened, RunState)
    assert chunks.read_checkpoint(bed.archive) is None, "at rest only the places are kept"


def run_steps(seen: list[int], kept: int) -> int:
    assert kept in seen
    return kept


def test_a_checkpoint_holds_every_byte_of_a_bed() -> None:
    rolling = Specimen((Species(1.0, 0.3, 100, rolling=0.1),), 4.0, 1)
    for specimen in (SMALL, rolling):
        state = packing.advance(specimen, None, 1500)
        again = chunks.read_checkpoint(chunks.checkpoint(state))
        assert again is not None
        for one, other in (
            (state, again),
            (packing.advance(specimen, state, 500), packing.advance(specimen, again, 500)),
        ):
            for name, value in vars(one).items():
                parts = value if isinstance(value, tuple) else (value,)
                others = getattr(other, name) if isinstance(value, tuple) else (getattr(other, name),)
                for a, b in zip(parts, others, strict=True):
                    assert type(a) is type(b), name
                    assert np.array_equal(a, b), name


def test_a_store_that_is_away_is_waited_for_and_the_plan_begun_anew(
    filled: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = iter([True, True] + [False, True, False, False] * 500)
    real = Store.write

    def write(self: Store) -> Any:
        if next(away):
            raise StoreAway("the database is restarting")
        return real(self)

    runner = Runner(filled, Counting())
    monkeypatch.setattr(Runner, "patiently", quick(Runner.patiently))
    blends = experiments.to_predict(filled, ())
    keys = list(ask_predictions(filled, blends, Way(), packing.VERSION).wishes.values())
    monkeypatch.setattr(Store, "write", write)
    reports = dict(answer(runner, keys))
    monkeypatch.setattr(Store, "write", real)
    assert {report.state for report in reports.values()} == {"done"}
    assert len(runner.pool.run) == len(set(runner.pool.run))
    assert {row.state for row in rows(filled, Prediction)} == {"done"}


def quick(patiently: Any) -> Any:
    """The same without waiting between tries."""
    import tenacity

    def hurry(self: Runner, call: Callable[[], Any]) -> Any:
        tries = tenacity.Retrying(
            retry=tenacity.retry_if_exception_type(StoreAway), stop=tenacity.stop_after_attempt(9)
        )
        return tries(call)

    return hurry


def test_a_store_that_stays_away_ends_with_its_sentence(filled: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdlab.batch.runner.PATIENCE", 0.3)

    def claims(session: Any, *_: Any) -> Any:
        raise StoreAway("the store lab cannot be used (connection refused); start the server")

    monkeypatch.setattr(store_room, "claim_runs", claims)
    with pytest.raises(StoreAway, match="connection refused"):
        Runner(filled, FormulaPool())([SMALL])


def test_a_runner_knows_which_others_of_its_machine_have_ended() -> None:
    import subprocess
    import sys

    code = "from pdlab.batch.names import own_name; print(own_name())"
    name = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert is_gone(name)
    assert not is_gone(own_name())
    host, _, rest = name.partition(" ")
    assert not is_gone(f"other{host} {rest}"), "of another machine nothing is known"


def test_a_runner_that_was_closed_holds_nothing_and_has_another_name(opened: Store) -> None:
    runner = Runner(opened, FormulaPool())
    before = runner.who
    assert not is_gone(before)
    runner.close()
    assert is_gone(before)
    assert runner.who != before
    assert not is_gone(runner.who)


def test_equal_beds_of_many_plans_run_once_and_plans_are_begun_as_they_are_needed(opened: Store) -> None:
    begun = list[int]()

    def works() -> Iterator[Work[int]]:
        for k in range(300):
            begun.append(k)
            yield Work(k, lambda k=k: asking(k))  # type: ignore[misc]

    def asking(k: int) -> Plan[int]:
        yield with_seeds(SMALL, [1 + k % 7, 100 + k])
        return k

    runner = Runner(opened, Counting())
    most_ahead = 0
    ended = list[int]()
    for key, result in runner.drive(works()):
        assert key == result
        ended.append(key)
        most_ahead = max(most_ahead, len(begun) - len(ended))
    assert sorted(ended) == list(range(300))
    assert len(runner.pool.run) == len(set(runner.pool.run)) == 307
    assert most_ahead <= 30


class Later(Counting):
    """Notes beds and ends each a moment later, so that several plans can ask for it before."""

    workers = 2

    def submit(self, specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        done, future = super().submit(specimen, state, steps, threads), Future[chunks.Advanced]()
        threading.Timer(0.2, lambda: future.set_result(done.result())).start()
        return future


def test_a_bed_that_is_under_way_is_not_handed_out_again(opened: Store) -> None:
    def asking() -> Plan[Any]:
        return (yield [SMALL])[0]

    runner = Runner(opened, Later())
    (_, first), (_, second) = runner.drive([Work(k, asking) for k in range(2)])
    assert first == second
    assert len(runner.pool.run) == 1


def test_no_more_beds_are_handed_out_than_the_workers_and_one_more(opened: Store) -> None:
    pool, most, ended = Later(), list[int](), list[int]()

    def submit(specimen: Specimen, state: Any, steps: int, threads: int) -> Future[chunks.Advanced]:
        future = Later.submit(pool, specimen, state, steps, threads)
        future.add_done_callback(lambda _: ended.append(1))
        most.append(len(pool.run) - len(ended))
        return future

    pool.submit = submit  # type: ignore[method-assign]
    Runner(opened, pool)(with_seeds(SMALL, range(1, 13)))
    assert max(most) == 3, "what a cancelled or dead runner leaves behind is bounded"


def test_more_seeds_than_are_kept_are_run(filled: Store) -> None:
    runner = Runner(filled, FormulaPool())
    few = predict(runner, (), Way("drop_and_roll", seeds=2))
    more = predict(runner, (), Way("drop_and_roll", seeds=5))
    assert {report.seeds for report in few} == {2}
    assert {report.seeds for report in more} == {5}


def test_a_plan_that_fails_stops_no_other(opened: Store) -> None:
    def failing() -> Plan[None]:
        yield [SMALL]
        raise PdlabError("this one cannot be")

    def fine() -> Plan[int]:
        return len((yield [SMALL]))

    outcomes = dict(Runner(opened, FormulaPool()).drive([Work("bad", failing), Work("good", fine)]))
    assert str(outcomes["bad"]) == "this one cannot be"
    assert outcomes["good"] == 1
