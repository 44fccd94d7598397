"""Pages that are served for a test: on a free port, awaited, ended."""

import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def free_port() -> int:
    """Return a port of 127.0.0.1 that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serving(module: str, *arguments: str, port: int, below: str = "", **how: Any) -> Iterator["subprocess.Popen[Any]"]:
    """Run a module that serves a Streamlit page on ``port`` until the block ends, which begins once it answers.

    ``below``: the path that its addresses begin with. ``how``: of the process, as ``subprocess.Popen`` takes it.
    """
    server = subprocess.Popen([sys.executable, "-m", module, *arguments], **how)
    try:
        for _ in range(600):
            assert server.poll() is None, "the server ended"
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{below}_stcore/health", timeout=1).close()
                break
            except OSError as error:
                if isinstance(error, urllib.error.HTTPError):  # it answers that it is not ready
                    error.close()
                time.sleep(0.1)
        else:
            raise AssertionError("the server does not answer")
        yield server
    finally:
        server.terminate()
        server.wait(30)
