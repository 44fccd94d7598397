"""The page and the runner beside it."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from pdlab.cli.shell import Scheduler, Store, Workers
from pdlab.errors import InputError

AGAIN, PATIENCE = 5.0, 20.0
"""Seconds after which a runner that ended is started again, and within which processes end by themselves."""


def _check_free(port: int) -> None:
    """Raise InputError when something listens on a port of 127.0.0.1."""
    import socket

    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a page that ended a moment ago is no hindrance
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"port {port} is not free ({error.strerror}); choose another with --port") from error


def serve(
    store: Store = None,
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8501,
    workers: Workers = None,
    scheduler: Scheduler = None,
    runner: Annotated[bool, typer.Option("--runner/--no-runner", help="Start a runner beside the page.")] = True,
) -> None:
    """Serve the page on 127.0.0.1, without telemetry, and a runner for what is wished for there; Ctrl-C ends both."""
    import importlib.util

    from pdlab.store import open_store, store_url

    _check_free(port)
    opened = open_store(store)
    opened.close()
    if opened.created:
        print(f"made a new store: {opened.url}")
    spec = importlib.util.find_spec("pdlab.page.app")
    assert spec is not None
    assert spec.origin is not None
    flags = {
        "server.address": "127.0.0.1", "server.port": str(port), "server.headless": "true",
        "server.maxUploadSize": "20", "browser.gatherUsageStats": "false", "client.toolbarMode": "viewer",
        "server.fileWatcherType": "none", "runner.magicEnabled": "false",
    }  # fmt: skip
    pages = ["-m", "streamlit", "run", spec.origin, *(f"--{key}={value}" for key, value in flags.items())]
    environment = {**os.environ, "PDLAB_STORE": store_url(store)}  # not in the arguments: it may hold a password
    print(f"the page: http://127.0.0.1:{port} (store {opened.url}; Ctrl-C ends it)", flush=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    started = [subprocess.Popen([sys.executable, *pages], env=environment)]
    try:
        if runner:
            options = [] if workers is None else ["--workers", str(workers)]
            options += [] if scheduler is None else ["--scheduler", scheduler]
            log = _log_beside(opened.url)
            print(f"the runner logs to {log}", flush=True)
            code = _watch(started, ["-m", "pdlab.cli", "-v", "runner", *options], environment, log)
        else:
            code = started[0].wait()
    except KeyboardInterrupt:
        code = 0
    finally:
        _end(started)
    sys.exit(code)


def _log_beside(url: str) -> Path:
    """Return where a runner logs: beside a SQLite file, else in the current folder."""
    file = url.removeprefix("sqlite:///")
    return Path(file).with_suffix(".runner.log") if file != url else Path("pdlab.runner.log")


def _watch(started: "list[subprocess.Popen[bytes]]", command: list[str], environment: dict[str, str], log: Path) -> int:
    """Keep a runner beside the page until the page ends; return the page's exit code."""
    page, runner = started[0], None
    with log.open("ab") as file:
        while page.poll() is None:
            if runner is None or runner.poll() is not None:
                if runner is not None:
                    print(f"the runner has ended (exit code {runner.returncode}, see {log}); another is started")
                    started.remove(runner)
                runner = subprocess.Popen([sys.executable, *command], env=environment, stdout=file, stderr=file)
                started.append(runner)
            with suppress(subprocess.TimeoutExpired):
                page.wait(AGAIN)
    return page.returncode


def _end(started: "list[subprocess.Popen[bytes]]") -> None:
    """End processes, by force where they do not end by themselves."""
    for process in started:
        process.terminate()
    for process in started:
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
