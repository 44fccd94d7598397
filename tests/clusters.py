"""A scheduler and workers of ``dask.distributed`` on loopback, which tests may kill; ``stop`` ends whatever is left."""

import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil
from servers import free_port

ROOT = Path(__file__).parent.parent


def loaded(module: str) -> bool:
    """Tell whether the process that runs this has imported a module."""
    return module in sys.modules


def children(pid: int) -> list[psutil.Process]:
    """The processes that ``multiprocessing`` spawned from one."""
    out = list[psutil.Process]()
    for child in psutil.Process(pid).children():
        with suppress(psutil.NoSuchProcess):  # it has just ended
            out += [child] if "spawn_main" in " ".join(child.cmdline()) else []
    return out


class Cluster:
    """``workers`` worker processes, each under a nanny that starts it again when it dies."""

    def __init__(self, folder: Path, workers: int, *options: str, scheduler_options: tuple[str, ...] = ()) -> None:
        self.folder, self.count, self.port = folder, workers, free_port()
        self.options, self.scheduler_options = options, scheduler_options
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def whole(self) -> "Cluster":
        """Start what is not there."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self.kill_workers(for_good=True)  # they end by themselves soon: they do not look for another scheduler
            if self.scheduler is not None:
                end(self.scheduler)
            self.start_scheduler()
        for worker in self.workers:
            if worker.poll() is not None:
                end(worker)
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < self.count:
            self.start_worker(*self.options)
        return self

    def start_scheduler(self) -> None:
        self.scheduler = self._schedule()
        for _ in range(300):
            if self.scheduler.poll() is not None:  # a connection of another program had the port
                end(self.scheduler)
                self.scheduler = self._schedule()
            with socket.socket() as tried:
                if tried.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.1)
        raise AssertionError("the scheduler has not started")

    def _schedule(self) -> "subprocess.Popen[bytes]":
        options = ("--port", str(self.port), "--idle-timeout", "3 hours", *self.scheduler_options)
        return self._start("scheduler", *options)

    def start_worker(self, *options: str) -> None:
        self.workers.append(self._start("worker", self.address, *(options or ("--nthreads", "1"))))

    def _start(self, verb: str, *options: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, __file__, verb, "--host", "127.0.0.1", "--no-dashboard"]
        paths = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
        with (self.folder / f"{verb}.log").open("ab") as out:
            return subprocess.Popen(
                [*command, *options], stdin=subprocess.PIPE, stdout=out, stderr=out, cwd=self.folder,
                start_new_session=True, env=os.environ | {"PYTHONPATH": paths},
            )  # fmt: skip

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        end(self.scheduler)

    def kill_workers(self, for_good: bool = False) -> None:
        """Kill the worker processes, and ``for_good`` the nannies that would start them again."""
        for worker in self.workers:
            if for_good:
                end(worker)
            else:
                for process in children(worker.pid):
                    process.kill()

    def alive(self) -> bool:
        return all(one is not None and one.poll() is None for one in (self.scheduler, *self.workers))

    def stop(self) -> None:
        self.kill_workers(for_good=True)
        if self.scheduler is not None:
            end(self.scheduler)


def end(process: "subprocess.Popen[bytes]") -> None:
    """Kill a process and all of its group."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    if process.stdin is not None:
        process.stdin.close()


def end_with_the_tests() -> None:
    """Kill this process and all of its group when the tests end, however they do."""
    sys.stdin.read()
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    threading.Thread(target=end_with_the_tests, daemon=True).start()
    importlib.import_module(f"distributed.cli.dask_{sys.argv[1]}").main(sys.argv[2:])
