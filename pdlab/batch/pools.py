"""Where beds are advanced: processes on this machine, or the workers of a ``dask.distributed`` cluster.

A pool is handed chunks of beds and returns futures. A chunk is a pure function, so that one that was lost with its
worker is simply submitted again. Workers know no database.
"""

import asyncio
import logging
import multiprocessing
import os
import re
import signal
import threading
import time
import warnings
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import suppress
from typing import Any, Protocol

from pdlab import packing
from pdlab.batch.chunks import Advanced, advance
from pdlab.errors import InputError, WorkersLost
from pdlab.specimen import Specimen

log = logging.getLogger(__name__)

PATIENCE = 120.0
"""Seconds that a cluster without a scheduler or without a worker is waited for."""
ANSWER = 8.0
"""Seconds in which a scheduler must answer."""
LOOK = 1.0
"""Seconds between two looks at a cluster."""
ALONE = 10.0
"""Seconds without a worker after which chunks count as lost: a nanny starts a dead worker anew in less."""

NO_WORKER = (
    "the cluster at {0} has no worker; waiting up to {1:g} s",
    "the cluster at {0} has had no worker for {1:g} s; start 'dask worker {0} --nthreads 1' on its machines, and this "
    "again",
)
NO_SCHEDULER = (
    "the scheduler at {0} does not answer; waiting up to {1:g} s",
    "the scheduler at {0} has not answered for {1:g} s; start the scheduler there, its workers, and this again",
)
"""What is said of a cluster at once, and when the patience is over."""


class Pool(Protocol):
    """Advances beds elsewhere; ``close`` it in the end."""

    @property
    def workers(self) -> int:
        """How many beds are advanced at once, at least 1; on a cluster it changes as workers come and go."""

    def submit(self, specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> "Future[Advanced]":
        """Hand out a chunk; the future holds what ``advance`` returns or raises, or a loss. Loses nothing itself."""

    def is_loss(self, error: BaseException) -> bool:
        """Tell whether a chunk was lost with a worker, the pool or the scheduler, so that it may be run again."""

    def renew(self) -> None:
        """Make the pool whole after a loss; chunks that still run go on. Raises WorkersLost when it cannot be."""

    def close(self, wait: bool = True) -> None:
        """End what the pool started, after the chunks handed out if ``wait``; it takes no more."""


def open_pool(workers: int, scheduler: str | None) -> Pool:
    """Return ``workers`` processes on this machine, or the cluster of a scheduler at ``tcp://HOST:PORT``.

    Raises InputError when no cluster can be reached there, WorkersLost when it has no worker.
    """
    return ProcessPool(workers) if scheduler is None else ClusterPool(scheduler)


def _failed(error: BaseException) -> "Future[Advanced]":
    future = Future[Advanced]()
    future.set_exception(error)
    return future


class ProcessPool:
    """Fresh processes on this machine, one bed in each."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._executor: ProcessPoolExecutor | None = None

    def submit(self, specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> "Future[Advanced]":
        """Hand out a chunk; the future holds what ``advance`` returns or raises, or a loss."""
        if self._executor is None:
            self._executor = ProcessPoolExecutor(self.workers, multiprocessing.get_context("spawn"), _start_worker)
        try:
            return self._executor.submit(advance, specimen, state, steps, threads)
        except BrokenExecutor as error:
            return _failed(error)

    def is_loss(self, error: BaseException) -> bool:
        """Tell whether a worker process died, which ends all of them."""
        return isinstance(error, BrokenExecutor)

    def renew(self) -> None:
        """Leave the broken processes behind; the next chunk starts new ones."""
        self.close(wait=False)

    def close(self, wait: bool = True) -> None:
        """End the processes after the chunks handed out if ``wait``, else, without waiting, after those begun."""
        if self._executor is not None:
            self._executor.shutdown(wait=wait, cancel_futures=not wait)
            self._executor = None


def _start_worker() -> None:
    """Leave Ctrl-C to the runner, and never outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class ClusterPool:
    """The workers of a ``dask.distributed`` cluster, one bed in each of their threads.

    Futures of its own ``ClientExecutor`` stay pending for good when a result is lost on its way, and say nothing when
    the last worker has gone; so they are made here, of what the client gathers.
    """

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        """Connect to the scheduler at ``address``, ``tcp://HOST:PORT``, and wait for a worker.

        ``patience`` [s]: how long a worker, or after a loss the scheduler, is waited for. Raises InputError when
        no scheduler answers or a worker has another engine, WorkersLost when no worker comes.
        """
        self.address, self.patience, self._threads, self._closed = _checked(address), patience, 0, False
        self._under_way: dict[Future[Advanced], Any] = {}
        try:
            self._connect(ANSWER)
        except OSError as error:
            raise InputError(
                f"no scheduler answered at {address} ({error}); start one there with "
                f"'dask scheduler --port {address.rpartition(':')[2]}', or correct the address"
            ) from error
        try:
            self._find_workers()
            self._check_workers()
        except BaseException:
            self.close(wait=False)
            raise

    @property
    def workers(self) -> int:
        """How many threads the cluster's workers have, looked up every second; 1 while there is none."""
        return max(1, self._threads)

    def submit(self, specimen: Specimen, state: packing.State | None, steps: int, threads: int) -> "Future[Advanced]":
        """Hand out a chunk; the future holds what ``advance`` returns or raises, or a loss.

        It holds InputError where a worker has another engine, or more than one bed of several threads each.
        """
        if self._closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        import dask

        client = self._client
        try:
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"}):  # beds are large
                chunk = client.submit(_chunk, _versions(), specimen, state, steps, threads, pure=False)
        except Exception as error:
            if client.status in ("running", "connecting"):
                raise
            return _failed(BrokenExecutor(f"the scheduler at {self.address} is lost: {error}"))
        future = asyncio.run_coroutine_threadsafe(self._outcome(client, chunk), client.loop.asyncio_loop)
        self._under_way[future] = chunk
        future.add_done_callback(lambda done: self._under_way.pop(done, None))
        return future

    def is_loss(self, error: BaseException) -> bool:
        """Tell whether the worker, several in a row, or the scheduler died under a chunk."""
        return isinstance(error, BrokenExecutor)

    def renew(self) -> None:
        """Connect anew where the scheduler was lost, and wait for a worker.

        Raises WorkersLost when there is none within the patience.
        """
        self._find_workers()

    def close(self, wait: bool = True) -> None:
        """Leave the cluster, after the chunks handed out if ``wait``; it lives on, and so do its workers."""
        self._closed = True
        under_way = list(self._under_way)
        if wait:
            wait_for(under_way)
        for future in under_way:
            future.cancel()
        wait_for(under_way, LOOK)
        self._disconnect()

    async def _outcome(self, client: Any, chunk: Any) -> Advanced:
        """Return what a chunk, a ``distributed.Future``, gave; raise what it raised, or BrokenExecutor for a loss."""
        from distributed import KilledWorker

        try:
            advanced: Advanced = await client.gather(chunk, asynchronous=True)
            return advanced
        except Exception as error:
            if chunk.status != "error" or isinstance(error, KilledWorker):
                why = " ".join(str(error).split())
                raise BrokenExecutor(f"a chunk was lost on the cluster at {self.address}: {why}") from error
            if isinstance(error, ImportError) or "deserialization of the task graph" in str(error):
                raise InputError(_no_pdlab(f"a machine of the cluster at {self.address}", error)) from error
            raise
        finally:
            chunk.release()

    async def _watch(self, client: Any) -> None:
        """Count the workers; chunks that have had none for a while are lost."""
        seen = time.monotonic()
        while True:
            await asyncio.sleep(LOOK)
            if client.status != "running":
                continue
            with suppress(OSError):
                threads = sum((await client.nthreads(asynchronous=True)).values())
                if threads or not self._under_way:
                    seen = time.monotonic()
                elif self._threads:
                    log.warning("the cluster at %s has no worker any more", self.address)
                self._threads = threads
                if time.monotonic() - seen > ALONE:
                    await client.cancel(list(self._under_way.values()), asynchronous=True)

    def _connect(self, timeout: float) -> None:
        """Connect. Raises OSError when no scheduler answers within about ``timeout`` [s]."""
        distributed = _distributed()
        distributed.utils.LoopRunner().run_sync(_shake_hands, distributed, self.address, timeout)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            self._client = distributed.Client(self.address, timeout=timeout, set_as_default=False, name="pdlab")
        for warning in said:
            log.warning("%s", warning.message)  # versions of Python, dask and the like that differ
        loop = self._client.loop.asyncio_loop
        self._watching = asyncio.run_coroutine_threadsafe(self._watch(self._client), loop)

    def _disconnect(self) -> None:
        self._watching.cancel()
        with suppress(OSError):
            self._client.close(timeout=ANSWER)

    def _find_workers(self) -> None:
        """Connect where that is needed, and wait for a worker. Raises WorkersLost after the patience."""
        deadline = time.monotonic() + self.patience
        told = "" if self._client.status == "running" else self._warn(NO_SCHEDULER)  # the first try may take long
        while True:
            try:
                self._threads, wrong = self._count(deadline - time.monotonic()), NO_WORKER
            except (OSError, RuntimeError) as error:  # RuntimeError: the client gives up just now
                self._threads, wrong = 0, NO_SCHEDULER
                log.info("%s: %s", self.address, error)
            if self._threads:
                return
            if time.monotonic() > deadline:
                raise WorkersLost(wrong[1].format(self.address, self.patience))
            if told != wrong[0]:
                told = self._warn(wrong)
            time.sleep(LOOK)

    def _warn(self, wrong: tuple[str, str]) -> str:
        log.warning(wrong[0].format(self.address, self.patience))
        return wrong[0]

    def _count(self, left: float) -> int:
        """Return the workers' threads, after a new connection where there is none. Raises OSError."""
        if self._client.status != "running":
            wait_for(list(self._under_way), LOOK)  # they end as lost
            self._disconnect()
            self._connect(max(LOOK, min(ANSWER, left)))
        return sum(self._client.nthreads().values())

    def _check_workers(self) -> None:
        """Look at all workers. Raises InputError when one has another engine, or none."""
        for worker, found in self._client.run(_versions, on_error="return").items():
            if isinstance(found, dict):
                _check_versions(worker, found, _versions())
            elif not isinstance(found, OSError):  # that worker has just gone
                raise InputError(_no_pdlab(f"the worker {worker}", found))


ADDRESS = re.compile(r"(?:tcp|tls)://(?:\[[^]]+]|[^:/\s]+):\d{1,5}")


def _checked(address: str) -> str:
    """Return a scheduler's address. Raises InputError when it is none."""
    if ADDRESS.fullmatch(address) is None or int(address.rpartition(":")[2]) > 65535:
        raise InputError(f"{address!r} is no address of a scheduler; write it as tcp://HOST:PORT, the port mostly 8786")
    return address


async def _shake_hands(distributed: Any, address: str, timeout: float) -> None:
    """Ask who is there: a client waits for ever for what is no scheduler. Raises OSError."""
    safely = distributed.Security().get_connection_args("client")
    there = distributed.rpc(address, timeout=timeout, connection_args=safely)
    try:
        found = await asyncio.wait_for(there.identity(), timeout)
    except Exception as error:  # whatever becomes of reading what another program says
        raise OSError(str(error) or f"nothing came back in {timeout:g} s") from error
    finally:
        await there.close_rpc()
    if "workers" not in found:
        raise OSError(f"there is a {found.get('type')}")


def _distributed() -> Any:
    """Import ``distributed``, whose log is kept from the terminal. Raises InputError when it is not installed."""
    try:
        import dask

        with dask.config.set(logging={"version": 1, "incremental": True}):  # else it writes to the terminal itself
            import distributed
    except ImportError as error:
        raise InputError("a cluster needs the package distributed: pip install 'pdlab[cluster]'") from error
    theirs = logging.getLogger("distributed")
    if not any(isinstance(handler, _Aside) for handler in theirs.handlers):
        theirs.addHandler(_Aside())
        theirs.propagate = False
    return distributed


class _Aside(logging.Handler):
    """Puts what ``distributed`` logs into this module's log, as information: what it means is said here."""

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on."""
        log.log(min(record.levelno, logging.INFO), "%s: %s", record.name, record.getMessage())


def _versions() -> dict[str, str]:
    """Return what must be the same on every machine of a cluster: it decides a bed's bytes."""
    return {"engine": str(packing.VERSION), "numba": packing.fingerprint()["numba"]}


def _check_versions(worker: str, found: dict[str, str], wanted: dict[str, str]) -> None:
    """Compare a worker's versions. Raises InputError when they are not the runner's."""
    if found != wanted:
        has, needs = (", ".join(f"{name} {number}" for name, number in each.items()) for each in (found, wanted))
        raise InputError(f"the worker {worker} has {has}, and here runs {needs}; install the same versions on both")


def _no_pdlab(who: str, error: BaseException) -> str:
    return (
        f"{who} cannot load pdlab ({error.__cause__ or error}); "
        "install the same version where the scheduler and each worker run"
    )


def _chunk(
    wanted: dict[str, str], specimen: Specimen, state: packing.State | None, steps: int, threads: int
) -> Advanced:
    """Advance a bed in a worker of a cluster. Raises InputError when it is not the worker for that."""
    import distributed

    worker = distributed.get_worker()
    _check_versions(worker.address, _versions(), wanted)
    beds = worker.state.nthreads
    if threads > 1 and beds > 1:  # they would wait for each other: numba shares its threads out to one at a time
        raise InputError(
            f"the worker {worker.address} works on {beds} beds at once, and each shall have {threads} threads; "
            "start the workers with --nthreads 1, or give each bed 1 thread"
        )
    return advance(specimen, state, steps, threads)
