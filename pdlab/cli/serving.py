"""The page and the runner beside it."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from pdlab.cli.shell import Scheduler, Store, Workers, end_as_by_ctrl_c
from pdlab.errors import InputError, SignInError

HERE = "127.0.0.1"
AGAIN, PATIENCE = 5.0, 20.0
"""Seconds after which a runner that ended is started again, and within which processes end by themselves."""


def _checked_place(address: str, port: int, signed_in: bool) -> str:
    """Return the number of an address at which a page may, and can, listen on a port.

    Whoever reaches the page can write to the store: beyond this machine only who has ``signed_in`` may. The page gets
    the number that was checked: a name may stand for several, and for another a moment later. Raises InputError.
    """
    import ipaddress
    import socket

    try:
        found = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)  # '*': all of them
    except (OSError, UnicodeError) as error:  # the latter from names that are none, such as 'a..b'
        why = getattr(error, "strerror", None) or error
        raise InputError(f"'{address}' is no address of this machine ({why}); write 127.0.0.1") from error
    family, _, _, _, place = found[0]
    number = str(place[0])
    if not (signed_in or ipaddress.ip_address(number).is_loopback):
        raise SignInError(
            f"at {address} everybody in the network could write to the store, since no sign-in is configured; "
            "configure one (docs/operation.md), or let a reverse proxy that asks who comes reach 127.0.0.1"
        )
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a page that ended a moment ago is no hindrance
        try:
            probe.bind(place)
        except OSError as error:
            raise InputError(
                f"port {port} of {address} is not free, or not of this machine ({error.strerror}); choose another with "
                "--port or --address"
            ) from error
    return number


def serve(
    store: Store = None,
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8501,
    address: Annotated[
        str, typer.Option(help="Where the page listens; anywhere but on this machine it needs a sign-in.")
    ] = HERE,
    workers: Workers = None,
    scheduler: Scheduler = None,
    runner: Annotated[bool, typer.Option("--runner/--no-runner", help="Start a runner beside the page.")] = True,
) -> None:
    """Serve the page on 127.0.0.1, without telemetry, and a runner for what is wished for there; Ctrl-C ends both."""
    from pdlab.page import signing_in
    from pdlab.store import open_store, store_url

    signed_in = signing_in.is_configured()
    number = _checked_place(address, port, signed_in)
    opened = open_store(store)
    opened.close()
    if opened.created:
        print(f"made a new store: {opened.url}")
    environment = {**os.environ, "PDLAB_STORE": store_url(store)}  # not in the arguments: it may hold a password
    if signed_in:
        environment[signing_in.REQUIRED] = "1"
    place = f"[{address}]" if ":" in address else address
    seen = "who signs in" if signed_in else "all on this machine, without a sign-in"
    print(f"the page: http://{place}:{port} for {seen} (store {opened.url}; Ctrl-C ends it)", flush=True)
    end_as_by_ctrl_c()
    hosts = [] if signed_in else _hosts(address)
    started = [subprocess.Popen([sys.executable, *_pages(number, port), *hosts], env=environment)]
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


def _pages(address: str, port: int) -> list[str]:
    """Return Python's arguments that serve the page."""
    import importlib.util

    spec = importlib.util.find_spec("pdlab.page.served")
    assert spec is not None
    assert spec.origin is not None
    flags = {
        "server.address": address, "server.port": str(port), "server.headless": "true",
        "server.maxUploadSize": "20", "browser.gatherUsageStats": "false", "client.toolbarMode": "viewer",
        "client.showErrorDetails": "none", "server.fileWatcherType": "none", "runner.magicEnabled": "false",
        "runner.postScriptGC": "false",  # it looks through 230 000 objects after every answer, and all others wait
        "theme.light.primaryColor": "#1f6f8b", "theme.dark.primaryColor": "#2a7ea8",
    }  # fmt: skip
    return ["-m", "streamlit", "run", spec.origin, *(f"--{key}={value}" for key, value in flags.items())]


def _hosts(address: str) -> list[str]:
    """Return Streamlit's flags for a page that answers to this machine's own names alone, or to those configured.

    A site of the web whose name is made to stand for 127.0.0.1 (DNS rebinding) comes with its own, from the browser of
    somebody on this machine.
    """
    from streamlit import config

    known = config.get_options_for_section("server")
    if "allowedHosts" not in known or known["allowedHosts"]:  # older versions of Streamlit have no such option
        return []
    return [f"--server.allowedHosts={name}" for name in dict.fromkeys(("localhost", HERE, "::1", address))]


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
