"""Plans carried on side by side: what they ask for is read or run, once for all, and handed to them.

Between chunks lie progress, Ctrl-C, checkpoints, the heartbeat, and the bound on what a dead worker costs.
"""

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pdlab import packing
from pdlab.batch.chunks import Advanced
from pdlab.batch.jobs import Job
from pdlab.batch.progress import Progress
from pdlab.errors import ClaimLost, EngineError, PdlabError, StoreAway, StoreError, WorkersLost
from pdlab.models import Run, RunState
from pdlab.plan import Outcome, Plan
from pdlab.specimen import Specimen

if TYPE_CHECKING:
    from pdlab.batch.runner import Runner

log = logging.getLogger(__name__)

T = TypeVar("T")
BEAT = 15.0
"""Seconds between heartbeats, well below the lease."""
CHECKPOINT = 60.0
"""Seconds after which a bed under way is kept in the store."""
POLL = 1.0
"""Seconds between looks at what other runners work on, and for new wishes."""
DRAIN = 5.0
"""Seconds in which the chunks of a broken pool say so."""
SUSPECT, LOST = 2, 4
"""How often in a row a bed's worker may die: from ``SUSPECT`` times on it runs alone, after ``LOST`` it has failed."""
LOST_POOLS = 8
"""Losses in a row, without one finished chunk, after which the runner gives up."""


@dataclass(frozen=True)
class Work(Generic[T]):
    """A plan to be carried on, under a key; ``begin`` makes it, anew where the store was away.

    ``claimed``: the key is a wish's, whose lease is to be renewed.
    """

    key: Any
    begin: Callable[[], Plan[T]]
    claimed: bool = False


@dataclass(eq=False)
class _Course(Generic[T]):
    """A work on its way: its plan, the beds that it asked for, by digest, and what is known of them."""

    work: Work[T]
    plan: Plan[T]
    digests: list[str] | None = None
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    answered: int = 0

    @property
    def is_ready(self) -> bool:
        return all(digest in self.outcomes for digest in self.digests or ())

    def next(self) -> list[Specimen]:
        """Hand the plan what it asked for; return what it asks for now. Raises StopIteration with its result."""
        found = None if self.digests is None else [self.outcomes[digest] for digest in self.digests]
        self.answered += len(self.outcomes)
        wanted = list(self.plan.send(found))  # type: ignore[arg-type]
        self.digests, self.outcomes = [specimen.digest(packing.VERSION) for specimen in wanted], {}
        return wanted

    def restart(self) -> None:
        """Begin the plan anew: what it asked for so far is in the store."""
        self.plan.close()
        self.plan, self.digests, self.outcomes, self.answered = self.work.begin(), None, {}, 0


class Drive(Generic[T]):
    """Works on their way together."""

    def __init__(self, runner: "Runner", works: Iterator[Work[T] | None], check: Callable[[], None]) -> None:
        """``check`` is called now and then; what it raises ends the drive."""
        self._runner, self._works, self._all_begun, self._check = runner, works, False, check
        self._courses = list[_Course[T]]()
        self._jobs = dict[str, Job]()  # all without an outcome, by digest
        self._waiting, self._elsewhere = list[Job](), list[Job]()
        self._active = dict[Future[Advanced], Job]()
        self._failed = dict[str, EngineError]()
        self._lost = 0
        self._read, self._simulated, self._sphere_steps = 0, 0, 0
        self._next_look, self._next_poll, self._next_beat = 0.0, 0.0, time.monotonic() + BEAT

    def results(self) -> Iterator[tuple[Any, T | PdlabError]]:
        """Yield the key and the result, or the error, of each work as it ends."""
        while True:
            self._check()
            yield from self._begin()
            if not self._courses and self._all_begun:
                return
            self._submit()
            self._collect()
            self._look_elsewhere()
            for course in [one for one in self._courses if one.is_ready]:
                yield from self._step(course)
            yield from self._heartbeat()

    def let_go(self) -> None:
        """Give up what has not ended: plans, chunks, claims."""
        for course in self._courses:
            course.plan.close()
        for future in self._active:
            future.cancel()
        self._free([job for job in self._jobs.values() if job.claimed])
        self._courses, self._jobs = [], {}

    def _free(self, jobs: list[Job]) -> None:
        try:
            if jobs:
                self._runner.free([job.digest for job in jobs])
        except PdlabError as error:  # their leases end by themselves
            log.warning("%s", error)

    def _begin(self) -> Iterator[tuple[Any, T | PdlabError]]:
        """Begin further works while there is too little to do."""
        workers = self._runner.pool.workers
        while len(self._waiting) < 2 * workers and len(self._courses) < 16 + 4 * workers:
            if self._all_begun or time.monotonic() < self._next_look:
                return
            try:
                work = self._runner.patiently(lambda: next(self._works))
            except StopIteration:
                self._all_begun = True
                return
            if work is None:
                self._next_look = time.monotonic() + POLL
                return
            course = _Course(work, work.begin())
            self._courses.append(course)
            yield from self._step(course)

    def _step(self, course: _Course[T]) -> Iterator[tuple[Any, T | PdlabError]]:
        """Carry a plan on as long as all that it asks for is known; yield its result when it ends."""
        while course.is_ready:
            result = self._runner.patiently(lambda: self._ask(course))
            if result is not None:
                self._courses.remove(course)
                yield course.work.key, result[0]
                return

    def _ask(self, course: _Course[T]) -> tuple[T | PdlabError] | None:
        """Let a plan ask for further beds, of which those that are not known become jobs; return its result, if any.

        Raises StoreAway, the plan being begun anew.
        """
        try:
            wanted = course.next()
            digests = course.digests or []
            course.outcomes = dict(self._runner.stored(digests))
        except StopIteration as end:
            return (end.value,)
        except StoreAway:
            course.restart()
            raise
        except StoreError:  # the disk is full: nothing can be kept of what is run
            raise
        except PdlabError as error:
            return (error,)
        self._read += len(course.outcomes)
        self._runner.read += len(course.outcomes)
        course.outcomes |= {digest: self._failed[digest] for digest in digests if digest in self._failed}
        missing = {
            digest: specimen
            for digest, specimen in zip(digests, wanted, strict=True)
            if digest not in course.outcomes and digest not in self._jobs
        }
        new = [Job(specimen, digest) for digest, specimen in missing.items()]
        self._jobs |= {job.digest: job for job in new}
        self._waiting += sorted(new, key=lambda job: -job.specimen.spheres)  # the longest first
        if new:
            self._tell()
        return None

    def _submit(self) -> None:
        """Hand out chunks: one bed more than there are workers, so that none waits; a suspect one alone."""
        while self._waiting and len(self._active) <= self._runner.pool.workers:
            suspect = any(job.lost >= SUSPECT for job in (*self._active.values(), self._waiting[0]))
            if suspect and self._active:
                return
            if not self._waiting[0].claimed:
                self._claim()
                continue
            job = self._waiting.pop(0)
            future = self._runner.pool.submit(job.specimen, job.state, job.steps, self._runner.threads)
            self._active[future] = job

    def _claim(self) -> None:
        """Claim the beds that are next; those that others work on, or have ended meanwhile, are looked at later."""
        most = 2 * self._runner.pool.workers + 2
        some = [job for job in self._waiting if not job.claimed][:most]
        mine = set(self._runner.patiently(lambda: self._runner.claim(some)))
        for job in some:
            job.claimed, job.kept_at = job in mine, time.monotonic()
        self._waiting = [job for job in self._waiting if job in mine or job not in some]
        self._elsewhere += [job for job in some if job not in mine]

    def _collect(self) -> None:
        """Wait for a chunk, for a moment, and take in what has come."""
        if not self._active:
            if self._elsewhere or not self._waiting:
                time.sleep(0.05)
            return
        ended = wait(self._active, timeout=POLL, return_when=FIRST_COMPLETED).done
        losses = [error for future in ended if self._is_loss(error := future.exception())]
        if losses:
            ended = wait(self._active, timeout=DRAIN).done
        for future in ended:
            self._take(self._active.pop(future), future)
        if ended:
            self._tell()
        if losses and losses[0] is not None:
            self._renew(losses[0])

    def _is_loss(self, error: BaseException | None) -> bool:
        return error is not None and self._runner.pool.is_loss(error)

    def _take(self, job: Job, future: Future[Advanced]) -> None:
        """Take in a chunk: keep the run when it has ended, else carry it on."""
        error = future.exception()
        if self._is_loss(error):
            job.lost += 1
            if job.lost < LOST:
                self._waiting.insert(0, job)
                return
            error = WorkersLost(f"its worker died {job.lost} times in a row ({error}); free some memory")
        if isinstance(error, EngineError):
            self._keep(*job.failed(error))
            self._failed[job.digest] = error
            self._end(job, error)
            return
        chunk, before = future.result(), 0 if job.progress is None else job.progress.steps  # raises what is no bed's
        job.take(chunk)
        self._lost = 0
        done = (chunk.progress.steps - before) * job.specimen.spheres
        self._sphere_steps += done
        self._runner.sphere_steps += done
        log.info(job.text())
        if chunk.result is not None:
            self._keep(*job.done(chunk))
            self._simulated += 1
            self._runner.simulated += 1
            self._end(job, replace(chunk.result, seconds=job.seconds))
        elif not any(job.digest in (course.digests or ()) for course in self._courses):
            del self._jobs[job.digest]  # nobody waits for it any more
            self._free([job])
        else:
            self._waiting.insert(0, job)
            if time.monotonic() - job.kept_at > CHECKPOINT:
                self._keep(*job.so_far())
                job.kept_at = time.monotonic()

    def _keep(self, run: Run, bed: RunState | None) -> None:
        self._runner.patiently(lambda: self._runner.keep(run, bed))

    def _end(self, job: Job, outcome: Outcome) -> None:
        """Hand a bed's outcome to all that asked for it."""
        self._jobs.pop(job.digest, None)
        for course in self._courses:
            if job.digest in (course.digests or ()):
                course.outcomes[job.digest] = outcome

    def _renew(self, error: BaseException) -> None:
        """Replace workers that died. Raises WorkersLost when they die again and again."""
        self._lost += 1
        if self._lost >= LOST_POOLS:
            raise WorkersLost(
                f"workers died {self._lost} times in a row without finishing a chunk ({error}); free some memory, or "
                "use fewer workers"
            )
        log.warning("a worker was lost (%s); its chunk runs again", error or type(error).__name__)
        self._runner.pool.renew()

    def _look_elsewhere(self) -> None:
        """See what became of beds that other runners work on; try again to have those that nobody works on."""
        if not self._elsewhere or time.monotonic() < self._next_poll:
            return
        self._next_poll = time.monotonic() + POLL
        jobs, self._elsewhere = self._elsewhere, []
        found = self._runner.patiently(lambda: self._runner.stored([job.digest for job in jobs]))
        self._read += len(found)
        self._runner.read += len(found)
        for job in jobs:
            if job.digest in found:
                self._end(job, found[job.digest])
            else:
                self._waiting.append(job)

    def _heartbeat(self) -> Iterator[tuple[Any, T | PdlabError]]:
        """Renew the leases; give up the works that are not wanted any more."""
        if time.monotonic() < self._next_beat:
            return
        self._next_beat = time.monotonic() + BEAT
        told = {course.work.key: self._share(course) for course in self._courses if course.work.claimed}
        try:
            held = self._runner.beat(told)
        except StoreAway as error:
            log.warning("%s", error)
            return
        for course in [one for one in self._courses if one.work.claimed and one.work.key not in held]:
            course.plan.close()
            self._courses.remove(course)
            kind, row_id = course.work.key
            yield course.work.key, ClaimLost(f"{kind} {row_id} was cancelled, or another runner has taken it over")
        wanted = {digest for course in self._courses for digest in course.digests or ()}
        idle = [job for job in (*self._waiting, *self._elsewhere) if job.digest not in wanted]
        for job in idle:
            (self._waiting if job in self._waiting else self._elsewhere).remove(job)
            del self._jobs[job.digest]
        self._free([job for job in idle if job.claimed])

    def _share(self, course: _Course[T]) -> float:
        """Return how much of what a plan has asked for so far is done."""
        digests = set(course.digests or ())
        under_way = sum(self._jobs[digest].share for digest in digests if digest in self._jobs)
        asked = course.answered + len(digests)
        return 0.99 * (course.answered + len(course.outcomes) + under_way) / asked if asked else 0.0

    def _tell(self) -> None:
        tell = self._runner.on_progress
        if tell is None:
            return
        ended = self._simulated + len(self._failed)
        wanted = ended + len(self._jobs)
        if wanted:
            share = (ended + sum(job.share for job in self._jobs.values())) / wanted
            beds = tuple(job.progress for job in self._jobs.values() if job.progress is not None)
            tell(Progress(wanted + self._read, self._read, ended, share, beds, self._sphere_steps))
