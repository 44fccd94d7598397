"""The page."""

import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import Store
from pdlab.errors import InputError

if TYPE_CHECKING:
    pass


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
) -> None:
    """Serve the page on 127.0.0.1, without telemetry; Ctrl-C ends it."""
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
    command = [
        sys.executable,
        "-m",
        "streamlit",
        "run",
        spec.origin,
        *(f"--{key}={value}" for key, value in flags.items()),
    ]
    print(f"the page: http://127.0.0.1:{port} (store {opened.url}; Ctrl-C ends it)", flush=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    page = subprocess.Popen(command, env={**os.environ, "PDLAB_STORE": store_url(store)})
    try:
        code = page.wait()
    except KeyboardInterrupt:
        code = 0
    finally:
        page.terminate()
        page.wait()
    sys.exit(code)
