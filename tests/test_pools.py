"""Both pools with the real engine in real processes, on small beds; what dies is killed for good reasons."""

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import dask
import numpy as np
import psutil
import pytest
from clusters import ROOT, Cluster, children, loaded
from servers import free_port

from pdlab import packing
from pdlab.batch import pools
from pdlab.batch.chunks import Advanced, where
from pdlab.batch.pools import ClusterPool, Pool, ProcessPool, open_pool
from pdlab.errors import InputError, NotAtRest, WorkersLost
from pdlab.specimen import Species, Specimen

SMALL = Specimen((Species(1.0, 0.3, 100),), 4.0, 1)
LONG = Specimen((Species(1.0, 0.3, 2000),), 9.0, 1)
ALL = 10**9
"""More steps than any bed needs."""


class Processes:
    """The place of a pool on this machine."""

    def open(self) -> Pool:
        return open_pool(2, None)

    def kill_workers(self) -> None:
        for process in children(os.getpid()):
            process.kill()


class OnCluster:
    """The place of a pool on a cluster."""

    def __init__(self, cluster: Cluster) -> None:
        self.cluster = cluster

    def open(self) -> Pool:
        return open_pool(2, self.cluster.address)

    def kill_workers(self) -> None:
        self.cluster.kill_workers()


Place = Processes | OnCluster


@pytest.fixture(params=["processes", "cluster"])
def place(request: pytest.FixtureRequest) -> Place:
    return Processes() if request.param == "processes" else OnCluster(request.getfixturevalue("cluster"))


@pytest.fixture(autouse=True)
def _own_main(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undo what a test of the page may have left: its script as the main module, which spawned processes import."""
    monkeypatch.setitem(sys.modules, "__main__", ModuleType("__main__"))


@pytest.fixture
def pool(place: Place) -> Iterator[Pool]:
    opened = place.open()
    yield opened
    opened.close()


@pytest.fixture
def on_cluster(cluster: Cluster) -> Iterator[ClusterPool]:
    opened = ClusterPool(cluster.address, patience=60.0)
    yield opened
    opened.close(wait=False)


def parts(value: Any) -> Any:
    """A state as plain values, its arrays as bytes."""
    if isinstance(value, tuple):
        return [parts(each) for each in value]
    return (value.shape, str(value.dtype), value.tobytes()) if isinstance(value, np.ndarray) else value


def bytes_of(state: packing.State) -> Any:
    return parts(tuple(vars(state).values()))


def is_bed(chunk: Advanced, specimen: Specimen) -> bool:
    """Tell whether a chunk brought a specimen's bed at rest, as this process has it."""
    here = packing.advance(specimen, None, ALL)
    measured = packing.measure(specimen, here, 0.0)
    assert chunk.result is not None
    return chunk.archive == where(here) and replace(chunk.result, seconds=0.0) == measured


def eventually(true: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Wait until something is true."""
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.1)
    return true()


def test_a_bed_has_the_bytes_of_this_process_however_it_is_cut(pool: Pool) -> None:
    first = pool.submit(SMALL, None, 1500, 1)
    assert isinstance(first, Future)
    progress, seconds, fingerprint, state, *_ = first.result()
    assert state is not None
    assert (state.steps, state.rest, progress) == (1500, "", packing.progress(SMALL, state))
    assert seconds > 0.0
    assert fingerprint == " ".join(packing.fingerprint()[name] for name in ("numba", "cpu"))
    assert is_bed(pool.submit(SMALL, state, ALL, 1).result(), SMALL)


def test_several_beds_are_advanced_at_once_and_each_is_its_own(pool: Pool) -> None:
    assert eventually(lambda: pool.workers == 2)
    beds = [replace(SMALL, seed=seed) for seed in range(1, 6)]
    chunks = [pool.submit(bed, None, ALL, 1) for bed in beds]
    for bed, chunk in zip(beds, chunks, strict=True):
        assert is_bed(chunk.result(), bed)


def test_the_error_of_a_bed_comes_with_its_class_message_and_state_and_is_no_loss(pool: Pool) -> None:
    endless = replace(packing.advance(SMALL, None, 500), stage_began=-(10**7))
    with pytest.raises(NotAtRest) as here:
        packing.advance(SMALL, endless, ALL)
    there = pool.submit(SMALL, endless, ALL, 1).exception()
    assert type(there) is NotAtRest
    assert str(there) == str(here.value)
    assert isinstance(there.state, packing.State)
    assert isinstance(here.value.state, packing.State)
    assert bytes_of(there.state) == bytes_of(here.value.state)
    assert not pool.is_loss(there)
    pool.submit(SMALL, None, 10, 1).result()  # nor does it cost the pool


def test_a_chunk_whose_worker_is_killed_is_run_again_or_lost_and_then_run_again(pool: Pool, place: Place) -> None:
    wait([pool.submit(SMALL, None, 10, 1) for _ in range(2)])  # the workers are up
    chunk = pool.submit(LONG, None, ALL, 1)
    time.sleep(0.5)
    assert not chunk.done()
    place.kill_workers()
    error = chunk.exception()
    if error is not None:
        assert pool.is_loss(error)
        pool.renew()
        chunk = pool.submit(LONG, None, ALL, 1)
    assert is_bed(chunk.result(), LONG)


def test_a_pool_that_lost_its_workers_says_so_on_the_next_submit_too() -> None:
    pool = ProcessPool(1)
    pool.submit(SMALL, None, 10, 1).result()
    Processes().kill_workers()
    errors = [pool.submit(SMALL, None, 10, 1).exception() for _ in range(3)]
    assert errors[-1] is not None
    assert all(error is None or pool.is_loss(error) for error in errors)
    pool.renew()
    pool.submit(SMALL, None, 10, 1).result()
    pool.close()


def test_workers_know_no_database(pool: Pool) -> None:
    pool.submit(SMALL, None, 10, 1).result()
    inside = pool._executor if isinstance(pool, ProcessPool) else pool._client.get_executor(pure=False)  # type: ignore[attr-defined]
    assert inside.submit(loaded, "numba").result()
    assert not inside.submit(loaded, "sqlalchemy").result()


@pytest.mark.parametrize("waits", [True, False])
def test_closing_ends_what_the_pool_started_and_nothing_else(place: Place, waits: bool) -> None:
    pool = place.open()
    pool.submit(SMALL, None, 10, 1).result()
    chunk = pool.submit(LONG, None, 2000, 1)
    pool.close(wait=waits)
    assert not waits or chunk.result().progress.steps == 2000
    assert eventually(lambda: not children(os.getpid()))
    assert "IO loop" not in {thread.name for thread in threading.enumerate()}
    assert eventually(chunk.done)
    if isinstance(place, OnCluster):
        with pytest.raises(RuntimeError, match="after shutdown"):
            pool.submit(SMALL, None, 10, 1)
        assert place.cluster.alive()
        again = place.open()
        again.submit(SMALL, None, 10, 1).result()
        again.close()


def test_worker_processes_leave_ctrl_c_to_the_runner() -> None:
    pool = ProcessPool(1)
    pool.submit(SMALL, None, 10, 1).result()
    chunk = pool.submit(LONG, None, 2000, 1)
    for process in children(os.getpid()):
        process.send_signal(signal.SIGINT)
    assert chunk.result().progress.steps == 2000
    pool.close()


def test_worker_processes_do_not_outlive_a_runner_that_was_killed(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import time; from pdlab.batch.pools import ProcessPool; from pdlab.specimen import Species, Specimen\n"
        "if __name__ == '__main__':\n"
        "    pool = ProcessPool(1)\n"
        "    pool.submit(Specimen((Species(1.0, 0.3, 100),), 4.0, 1), None, 10, 1).result()\n"
        "    print(*pool._executor._processes, flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, env=here()) as runner:
        assert runner.stdout is not None
        worker = int(runner.stdout.readline())
        assert psutil.pid_exists(worker)
        runner.kill()
    assert eventually(lambda: not psutil.pid_exists(worker), 20.0)


def here() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}


def test_a_scheduler_that_is_killed_loses_its_chunks_and_is_found_again(
    cluster: Cluster, on_cluster: ClusterPool
) -> None:
    chunks = [on_cluster.submit(LONG, None, ALL, 1) for _ in range(3)]
    time.sleep(0.5)
    cluster.kill_scheduler()
    errors = [chunk.exception() for chunk in chunks]
    assert all(error is not None and on_cluster.is_loss(error) for error in errors)
    threading.Timer(2.0, cluster.whole).start()  # while it is looked for
    on_cluster.renew()
    chunk = on_cluster.submit(SMALL, None, ALL, 1)
    assert is_bed(chunk.result(), SMALL)


def test_a_scheduler_that_is_gone_for_good_ends_in_one_named_error(cluster: Cluster) -> None:
    pool = ClusterPool(cluster.address, patience=3.0)
    chunk = pool.submit(LONG, None, ALL, 1)
    cluster.kill_scheduler()
    error = chunk.exception()
    assert error is not None
    assert pool.is_loss(error)
    begun = time.monotonic()
    with pytest.raises(WorkersLost, match=rf"{cluster.address} has not answered for 3 s; start the scheduler") as said:
        pool.renew()
    assert "\n" not in str(said.value)
    assert 3.0 <= time.monotonic() - begun < 20.0
    lost = pool.submit(SMALL, None, 10, 1).exception()
    assert lost is not None
    assert pool.is_loss(lost)
    pool.close()


def test_a_result_that_is_lost_on_its_way_is_a_loss(on_cluster: ClusterPool, monkeypatch: pytest.MonkeyPatch) -> None:
    async def torn(*_: object) -> None:
        raise OSError("the connection was torn")

    with monkeypatch.context() as patched:
        patched.setattr("distributed.client.retry_operation", torn)
        error = on_cluster.submit(SMALL, None, 10, 1).exception(timeout=60.0)
    assert error is not None
    assert on_cluster.is_loss(error)
    on_cluster.renew()
    on_cluster.submit(SMALL, None, 10, 1).result()


def check_no_scheduler(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert pools.ANSWER <= 8.0
    monkeypatch.setattr(pools, "ANSWER", 2.0)
    begun = time.monotonic()
    with pytest.raises(
        InputError, match=rf"no scheduler answered at {address} .*; start one .* or correct the address"
    ):
        ClusterPool(address)
    assert time.monotonic() - begun < 6.0
    assert "IO loop" not in {thread.name for thread in threading.enumerate()}


def test_a_dead_address_is_an_input_error_within_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    check_no_scheduler(f"tcp://127.0.0.1:{free_port()}", monkeypatch)


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH_9.2\r\n", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_another_program_at_the_address_is_an_input_error_within_seconds(
    greeting: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)

        def serve() -> None:
            with server.accept()[0] as connection:
                connection.sendall(greeting)
                while connection.recv(10**6):  # until the other side leaves
                    pass

        greeter = threading.Thread(target=serve)
        greeter.start()
        check_no_scheduler(f"tcp://127.0.0.1:{server.getsockname()[1]}", monkeypatch)
        greeter.join()


def test_the_address_of_a_worker_is_an_input_error(on_cluster: ClusterPool) -> None:
    with pytest.raises(InputError, match="there is a Worker"):
        ClusterPool(next(iter(on_cluster._client.nthreads())))


@pytest.mark.parametrize("address", ["", "localhost:8786", "http://127.0.0.1:8786", "tcp://127.0.0.1", "tcp://a:99999"])
def test_what_is_no_address_is_refused_with_the_form_of_one(address: str) -> None:
    with pytest.raises(InputError, match="is no address of a scheduler; write it as tcp://HOST:PORT"):
        ClusterPool(address)


def test_a_cluster_without_workers_is_said_at_once_and_an_error_after_the_patience(
    new_cluster: Callable[..., Cluster], caplog: pytest.LogCaptureFixture
) -> None:
    empty = new_cluster(0)
    with pytest.raises(WorkersLost, match=rf"{empty.address} has had no worker for 2 s; start 'dask worker"):
        ClusterPool(empty.address, patience=2.0)
    warned = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert [record.getMessage() for record in warned] == [
        f"the cluster at {empty.address} has no worker; waiting up to 2 s"
    ]


def test_workers_are_counted_as_they_come_and_chunks_of_the_last_that_goes_are_lost(
    new_cluster: Callable[..., Cluster], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "ALONE", 2.0)
    cluster = new_cluster(1)
    pool = ClusterPool(cluster.address, patience=60.0)
    assert pool.workers == 1
    cluster.start_worker("--nthreads", "2")
    assert eventually(lambda: pool.workers == 3)
    chunk = pool.submit(LONG, None, ALL, 1)
    cluster.kill_workers(for_good=True)
    error = chunk.exception(timeout=60.0)
    assert error is not None
    assert pool.is_loss(error)
    cluster.whole()
    pool.renew()
    assert pool.submit(SMALL, None, 10, 1).result().progress.steps == 10
    pool.close()


def test_a_worker_of_several_threads_works_on_as_many_beds_but_not_with_threads_for_each(
    new_cluster: Callable[..., Cluster],
) -> None:
    pool = ClusterPool(new_cluster(1, "--nthreads", "2").address)
    assert pool.workers == 2
    chunks = [pool.submit(replace(SMALL, seed=seed), None, ALL, 1) for seed in (1, 2)]
    for seed, chunk in zip((1, 2), chunks, strict=True):
        assert is_bed(chunk.result(), replace(SMALL, seed=seed))
    error = pool.submit(SMALL, None, 10, 2).exception()
    assert isinstance(error, InputError)
    assert "start the workers with --nthreads 1, or give each bed 1 thread" in str(error)
    assert not pool.is_loss(error)
    pool.close()


def test_a_worker_with_another_engine_is_refused_by_name_whenever_it_comes(
    new_cluster: Callable[..., Cluster], tmp_path: Path
) -> None:
    old = tmp_path / "old.py"
    old.write_text("from pdlab import packing\npacking.VERSION = -1\n")
    cluster = new_cluster(1)
    pool = ClusterPool(cluster.address)
    cluster.kill_workers(for_good=True)
    cluster.start_worker("--preload", str(old))
    refused = rf"the worker tcp://127\.0\.0\.1:\d+ has engine -1, numba .* and here runs engine {packing.VERSION}, "
    chunk = pool.submit(SMALL, None, 10, 1)
    error = chunk.exception()
    assert isinstance(error, InputError)
    assert not pool.is_loss(error)
    pool.close()
    with pytest.raises(InputError, match=refused):
        raise error
    with pytest.raises(InputError, match=refused):
        ClusterPool(cluster.address)


@pytest.mark.parametrize("where", ["worker", "scheduler"])
def test_a_machine_without_pdlab_is_refused(where: str, new_cluster: Callable[..., Cluster], tmp_path: Path) -> None:
    bare = tmp_path / "bare.py"
    bare.write_text("import sys\nsys.modules['pdlab'] = None\n")
    options = ("--preload", str(bare))
    cluster = new_cluster(1, *options) if where == "worker" else new_cluster(1, scheduler_options=options)
    with pytest.raises(InputError, match=r"cannot load pdlab \(.*\); install the same version where the scheduler"):
        first_steps(cluster.address)


def first_steps(address: str) -> None:
    pool = ClusterPool(address)
    try:
        pool.submit(SMALL, None, 10, 1).result()
    finally:
        pool.close()


def test_without_the_extra_a_cluster_is_refused_with_the_way_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'pdlab\[cluster\]'"):
        open_pool(1, "tcp://127.0.0.1:8786")


def test_large_beds_are_sent_without_a_warning(on_cluster: ClusterPool) -> None:
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 B"}):
        on_cluster.submit(SMALL, None, 10, 1).result()


NOISY = """
import logging, sys
logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
from pdlab.errors import WorkersLost
from pdlab.batch.pools import ClusterPool
from pdlab.specimen import Species, Specimen
pool = ClusterPool(sys.argv[1], patience=2.0)
chunk = pool.submit(Specimen((Species(1.0, 0.3, 2000),), 9.0, 1), None, 10**9, 1)
print("ready", flush=True)
assert pool.is_loss(chunk.exception())
try:
    pool.renew()
except WorkersLost as error:
    print(error)
pool.close()
"""


def test_what_distributed_logs_stays_out_of_the_terminal(cluster: Cluster) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", NOISY, cluster.address],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=here(),
    ) as runner:  # fmt: skip
        assert runner.stdout is not None
        assert runner.stdout.readline() == "ready\n"
        cluster.kill_scheduler()
        out, err = runner.communicate(timeout=60.0)
    assert runner.returncode == 0, err
    assert len(out.splitlines()) == 1
    assert err.splitlines() == [
        f"pdlab.batch.pools: the scheduler at {cluster.address} does not answer; waiting up to 2 s"
    ]
