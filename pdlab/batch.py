"""The runner: specimens in, packings out; what is in the store is read, the rest runs on an executor.

Chunks of a few seconds go to a spawn process pool; every finished run is written at once. Between
chunks lie progress, Ctrl-C, and the bound on what a dead worker costs.
"""

import io
import json
import logging
import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field

import numpy as np

from pdlab import packing, store
from pdlab.errors import EngineError, WorkersLost
from pdlab.experiments.readings import packing_of
from pdlab.models import Run, RunState, now
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store

log = logging.getLogger(__name__)

CHUNK = 20_000_000
"""Sphere-steps handed out at once: a few seconds."""
LOST_POOLS = 3
"""Pools in a row that may die without one finished chunk before the runner gives up."""


@dataclass(frozen=True)
class Progress:
    """How far a call is: runs wanted, read from the store and simulated, and the share of work done.

    ``beds``: how far those are that run now.
    """

    wanted: int
    read: int
    simulated: int
    share: float
    beds: tuple[packing.Progress, ...] = ()


Advanced = tuple[packing.State, packing.Progress, float]


def advance(specimen: Specimen, state: packing.State | None, steps: int, threads: int = 1) -> Advanced:
    """Advance a bed in a worker; return it, how far it is, and the seconds that took. Workers know no database."""
    begun = time.perf_counter()
    state = packing.advance(specimen, state, steps, threads)
    return state, packing.progress(specimen, state), time.perf_counter() - begun


def _start_worker() -> None:
    """Leave Ctrl-C to the runner, and never outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def spawn_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool of fresh processes, one simulation in each."""
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start_worker)


@dataclass
class _Job:
    """A specimen on its way: its bed after the last chunk and the seconds spent."""

    specimen: Specimen
    digest: str
    state: packing.State | None = None
    progress: packing.Progress | None = None
    seconds: float = 0.0

    @property
    def steps(self) -> int:
        return max(1, CHUNK // self.specimen.spheres)

    @property
    def share(self) -> float:
        """A guess at the share of its steps that lie behind it."""
        return 0.0 if self.progress is None else self.progress.share


def cores() -> int:
    """Return the processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class Runner:
    """Runs specimens on ``workers`` processes of ``threads`` threads each for one store; callable as ``run_all``.

    ``on_progress`` is called at the beginning and after every chunk. ``simulated`` and ``read`` count over
    all calls. The processes live from the first run that is needed to ``close``.
    """

    target: Store
    workers: int = field(default_factory=cores)
    on_progress: Callable[[Progress], None] | None = None
    make_pool: Callable[[int], Executor] = spawn_pool
    threads: int = 1
    simulated: int = 0
    read: int = 0
    _pool: Executor | None = None

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing | EngineError]:
        """Return each specimen's packing, or the error in its place, in order; equal ones run once.

        Raises WorkersLost when worker processes die again and again.
        """
        digests = [specimen.digest(packing.VERSION) for specimen in specimens]
        with self.target.read() as session:
            stored = store.done_runs(session, digests)
        done: dict[str, Packing | EngineError] = {digest: packing_of(run) for digest, run in stored.items()}
        self.read += len(done)
        jobs = {
            digest: _Job(specimen, digest)
            for digest, specimen in zip(digests, specimens, strict=True)
            if digest not in done
        }
        if jobs:
            self._run(jobs, done)
        return [done[digest] for digest in digests]

    @property
    def engine_version(self) -> int:
        """The version of the engine that runs here."""
        return packing.VERSION

    def close(self, wait: bool = True) -> None:
        """End the worker processes, after the chunks that they work on if ``wait``; the next call starts new ones."""
        if self._pool is not None:
            self._pool.shutdown(wait=wait, cancel_futures=True)
            self._pool = None

    def _run(self, jobs: dict[str, _Job], done: dict[str, Packing | EngineError]) -> None:
        waiting = sorted(jobs.values(), key=lambda job: -job.specimen.spheres)  # the longest first
        active: dict[Future[Advanced], _Job] = {}
        lost, read = 0, len(done)
        self._tell(jobs, done, read)
        try:
            while waiting or active:
                try:
                    while waiting and len(active) < self.workers:
                        job = waiting[0]
                        active[self._submit(job)] = job
                        waiting.pop(0)  # not before: a pool found broken keeps it waiting
                    for future in wait(active, return_when=FIRST_COMPLETED).done:
                        waiting = self._take(active[future], future, done) + waiting
                        del active[future]
                        lost = 0
                except BrokenProcessPool:
                    lost += 1
                    waiting, active = [*active.values(), *waiting], {}
                    self._give_up_pool(lost)
                self._tell(jobs, done, read)
        except BaseException:  # Ctrl-C too: no worker goes on with what nobody waits for
            self.close(wait=False)
            raise

    def _submit(self, job: _Job) -> Future[Advanced]:
        if self._pool is None:
            self._pool = self.make_pool(self.workers)
        return self._pool.submit(advance, job.specimen, job.state, job.steps, self.threads)

    def _take(self, job: _Job, future: Future[Advanced], done: dict[str, Packing | EngineError]) -> list[_Job]:
        """Take a chunk's result: keep the run when it has ended, else return it to be carried on."""
        try:
            job.state, job.progress, seconds = future.result()
            job.seconds += seconds
            log.info(_chunk_text(job))
            if not job.state.rest:
                return [job]
            done[job.digest] = self._save(job)
        except EngineError as error:
            job.state = error.state if isinstance(error.state, packing.State) else job.state
            self._save_failure(job, error)
            done[job.digest] = error
        return []

    def _give_up_pool(self, lost: int) -> None:
        """Leave a broken pool behind. Raises WorkersLost when pools break again and again."""
        self.close(wait=False)
        if lost >= LOST_POOLS:
            raise WorkersLost(
                f"{lost} pools of worker processes died in a row without finishing a chunk; "
                "free some memory, or use fewer workers"
            )
        log.warning("a worker process died; its chunk runs again")

    def _tell(self, jobs: dict[str, _Job], done: dict[str, Packing | EngineError], read: int) -> None:
        if self.on_progress is not None:
            shares = [1.0 if digest in done else job.share for digest, job in jobs.items()]
            ended = sum(digest in done for digest in jobs)
            beds = [job.progress for digest, job in jobs.items() if digest not in done and job.progress is not None]
            self.on_progress(Progress(len(jobs) + read, read, ended, sum(shares) / len(jobs), tuple(beds)))

    def _save(self, job: _Job) -> Packing:
        """Measure a bed at rest and write its run. Raises EngineError when it is no packing."""
        assert job.state is not None
        result = packing.measure(job.specimen, job.state, job.seconds)
        run = _run_row(job, "done")
        run.packing_density = None if math.isnan(result.packing_density) else result.packing_density  # a heap's
        for name in (
            "repose_angle_deg", "coordination_number", "height", "largest_overlap", "rest", "steps", "seconds",
        ):  # fmt: skip
            setattr(run, name, getattr(result, name))
        run.slab_shares = json.dumps(result.slab_shares)
        run.warnings = "\n".join(result.warnings) or None
        self._keep(run, _state_row(job))
        self.simulated += 1
        return result

    def _save_failure(self, job: _Job, error: EngineError) -> None:
        """Keep a failed run with its reason and its last bed."""
        run = _run_row(job, "failed")
        run.error = str(error)
        self._keep(run, _state_row(job) if job.state is not None else None)

    def _keep(self, run: Run, state: RunState | None) -> None:
        with self.target.write() as session:
            store.save_run(session, run, state)


@dataclass
class Repeater(Runner):
    """Runs specimens anew, whatever the store holds, and writes nothing."""

    _kept: dict[str, tuple[Run, RunState | None]] = field(default_factory=dict)

    def repeat(self, specimens: Sequence[Specimen]) -> list[tuple[Run, RunState | None]]:
        """Return, in order, each specimen's run and bed as a ``Runner`` would keep them, failed ones too.

        Raises WorkersLost when worker processes die again and again.
        """
        self._kept = {}
        jobs = {bed.digest(packing.VERSION): _Job(bed, bed.digest(packing.VERSION)) for bed in specimens}
        if jobs:
            self._run(jobs, {})
        return [self._kept[specimen.digest(packing.VERSION)] for specimen in specimens]

    def _keep(self, run: Run, state: RunState | None) -> None:
        self._kept[run.specimen_hash] = run, state


def _chunk_text(job: _Job) -> str:
    """Return a bed's progress as a line of the log."""
    assert job.progress is not None
    left = job.seconds * (1.0 / max(job.share, 1e-3) - 1.0)
    return (
        f"bed {job.digest[:12]}, {job.specimen.spheres} spheres: {job.progress.steps} steps, kinetic energy "
        f"{job.progress.kinetic_energy:.1e} m g d, out of balance {job.progress.out_of_balance:.1e}, "
        f"{job.seconds:.0f} s, about {left:.0f} s left"
    )


def _run_row(job: _Job, state: str) -> Run:
    engine = packing.fingerprint()
    return Run(
        specimen_hash=job.digest,
        specimen=job.specimen.canonical(packing.VERSION),
        engine_version=packing.VERSION,
        numba_version=engine["numba"],
        processor=engine["cpu"],
        seed=job.specimen.seed,
        spheres=job.specimen.spheres,
        state=state,
        error=None,  # a try that failed before is over
        finished_at=now(),
    )


def _state_row(job: _Job) -> RunState:
    assert job.state is not None
    archive = io.BytesIO()
    np.savez_compressed(archive, place=job.state.place, species=job.state.species.astype(np.uint8))
    return RunState(specimen_hash=job.digest, steps=job.state.steps, archive=archive.getvalue())
