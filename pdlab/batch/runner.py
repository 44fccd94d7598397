"""The runner: carries plans on, reads what is in the store, and has the rest advanced by a pool, chunk by chunk.

Every finished run is written at once. Several runners may share a store: what one works on, the others wait for.
"""

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import tenacity

from pdlab import packing, store
from pdlab.batch import interrupts
from pdlab.batch.driving import Drive, Work
from pdlab.batch.jobs import Job
from pdlab.batch.names import is_gone, leave, own_name
from pdlab.batch.pools import Pool, ProcessPool
from pdlab.batch.progress import Progress
from pdlab.errors import PdlabError, StoreAway
from pdlab.experiments.readings import packing_of
from pdlab.models import Run, RunState
from pdlab.plan import Outcome, Plan
from pdlab.specimen import Packing, Specimen
from pdlab.store import Key, Store

log = logging.getLogger(__name__)

T = TypeVar("T")
PATIENCE = 300.0
"""Seconds that a store may be away."""


def cores() -> int:
    """Return the processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class Runner:
    """Carries plans on for one store; callable as ``run_all``.

    ``pool``: where beds are advanced, ``threads`` threads to each. ``on_progress`` is called at the beginning and
    after every chunk. ``simulated``, ``read`` and ``sphere_steps`` count over all calls. ``who``: the name under which
    it claims. The workers live from the first run that is needed to ``close``.
    """

    target: Store
    pool: Pool = field(default_factory=lambda: ProcessPool(cores()))
    on_progress: Callable[[Progress], None] | None = None
    threads: int = 1
    simulated: int = 0
    read: int = 0
    sphere_steps: int = 0
    who: str = field(default_factory=own_name)

    @property
    def engine_version(self) -> int:
        """The version of the engine that runs here."""
        return packing.VERSION

    def __call__(self, specimens: Sequence[Specimen]) -> list[Outcome]:
        """Return each specimen's packing, or the error in its place, in order; equal ones run once.

        Raises WorkersLost, StoreError.
        """

        def asking() -> Plan[list[Outcome]]:
            return list((yield specimens))

        ((_, outcomes),) = self.drive([Work(None, asking)])
        if isinstance(outcomes, PdlabError):
            raise outcomes
        return outcomes

    def drive(self, works: Iterable[Work[T] | None]) -> Iterator[tuple[Any, T | PdlabError]]:
        """Carry works on side by side; yield the key and the result, or the error, of each as it ends.

        ``works`` is read as they are needed; a None says that there is none at the moment. Raises WorkersLost,
        StoreError.
        """
        with interrupts.kept() as check:
            drive = Drive(self, iter(works), check)
            try:
                yield from drive.results()
            finally:  # Ctrl-C too: no worker goes on with what nobody waits for
                drive.let_go()

    def close(self, wait: bool = True) -> None:
        """End the workers, after the chunks that they work on if ``wait``, and whatever is still claimed.

        The next call starts new ones, under a new name.
        """
        self.pool.close(wait)
        leave(self.who)
        self.who = own_name()

    def patiently(self, call: Callable[[], T]) -> T:
        """Return what a call gives, again and again while the store is away. Raises StoreAway in the end."""
        retrying = tenacity.Retrying(
            retry=tenacity.retry_if_exception_type(StoreAway),
            wait=tenacity.wait_exponential(0.1, max=5.0),
            stop=tenacity.stop_after_delay(PATIENCE),
            before_sleep=lambda state: log.warning("%s; trying again", state.outcome and state.outcome.exception()),
            reraise=True,
        )
        return retrying(call)

    def stored(self, digests: Sequence[str]) -> dict[str, Packing]:
        """Return what the store holds of runs that are done."""
        with self.target.read() as session:
            return {digest: packing_of(run) for digest, run in store.done_runs(session, digests).items()}

    def claim(self, jobs: Sequence[Job]) -> list[Job]:
        """Claim runs; return those that are this runner's now, each where a runner before left it."""
        with self.target.write() as session:
            rows = store.claim_runs(session, [job.run("running") for job in jobs], self.who, is_gone)
        for job in jobs:
            if (left := rows.get(job.digest)) is not None:
                job.resume(*left)
        return [job for job in jobs if job.digest in rows]

    def keep(self, run: Run, bed: RunState | None) -> None:
        """Write a run."""
        with self.target.write() as session:
            store.save_run(session, run, bed)

    def free(self, digests: Sequence[str]) -> None:
        """Leave claimed runs to others."""
        with self.target.write() as session:
            store.free_runs(session, digests, self.who)

    def beat(self, progress: Mapping[Key, float]) -> set[Key]:
        """Renew the leases; return the wishes, of those whose progress is told, that are still this runner's."""
        with self.target.write() as session:
            return store.beat(session, self.who, progress)


@dataclass
class Repeater(Runner):
    """Runs specimens anew, whatever the store holds, and writes nothing."""

    _kept: dict[str, tuple[Run, RunState | None]] = field(default_factory=dict)

    def repeat(self, specimens: Sequence[Specimen]) -> list[tuple[Run, RunState | None]]:
        """Return, in order, each specimen's run and bed as a ``Runner`` would keep them, failed ones too.

        Raises WorkersLost when worker processes die again and again.
        """
        self._kept = {}
        self(specimens)
        return [self._kept[specimen.digest(packing.VERSION)] for specimen in specimens]

    def stored(self, digests: Sequence[str]) -> dict[str, Packing]:
        """Return nothing: all runs anew."""
        return {}

    def claim(self, jobs: Sequence[Job]) -> list[Job]:
        """Return all jobs, of which the store need not know."""
        return list(jobs)

    def keep(self, run: Run, bed: RunState | None) -> None:
        """Keep a run in memory."""
        if run.state != "running":
            self._kept[run.specimen_hash] = run, bed

    def free(self, digests: Sequence[str]) -> None:
        """Leave nothing, as nothing was claimed."""

    def beat(self, progress: Mapping[Key, float]) -> set[Key]:
        """Hold no lease."""
        return set(progress)
