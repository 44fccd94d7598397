"""``pdlab serve``: the page and a runner beside it, started and ended together."""

import signal
import subprocess
import sys
import time
import tomllib
import urllib.request
from contextlib import closing
from http import HTTPStatus
from http.client import HTTPConnection
from pathlib import Path

import psutil
import pytest
from servers import free_port, serving

from pdlab import experiments
from pdlab.cli.serving import _pages
from pdlab.experiments import Way, register
from pdlab.lab import SHIPPED
from pdlab.models import Prediction
from pdlab.store import Store, open_store
from pdlab.tables import read_path


def states(target: Store) -> set[str]:
    with target.read() as session:
        return {row.state for row in session.query(Prediction)}


def answers(port: int, host: str) -> bool:
    """Return whether the page opens its socket for a browser that knows this machine by a name."""
    asked = {
        "Host": f"{host}:{port}", "Origin": f"http://{host}:{port}", "Upgrade": "websocket", "Connection": "Upgrade",
        "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==", "Sec-WebSocket-Version": "13",
    }  # fmt: skip
    with closing(HTTPConnection("127.0.0.1", port, timeout=10)) as reached:
        reached.request("GET", "/_stcore/stream", headers=asked)
        return reached.getresponse().status == HTTPStatus.SWITCHING_PROTOCOLS


def test_what_the_configuration_of_a_clone_says_is_what_serve_says() -> None:
    with (Path(__file__).parents[1] / ".streamlit" / "config.toml").open("rb") as file:
        sections = tomllib.load(file)
    sections |= {f"theme.{name}": values for name, values in sections.pop("theme").items()}
    flags = [f"--{name}.{key}={value}" for name, values in sections.items() for key, value in values.items()]
    told = {flag.replace("=True", "=true").replace("=False", "=false") for flag in flags}
    assert told <= set(_pages("127.0.0.1", 8501))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_what_is_wished_for_is_answered_while_the_page_is_served_and_both_end(tmp_path: Path) -> None:
    target = open_store(tmp_path / "lab.db")
    register(target, read_path(SHIPPED))
    experiments.ask_predictions(target, experiments.to_predict(target, ()), Way("drop_and_roll"), 0)
    assert states(target) == {"queued"}
    port = free_port()
    command = [sys.executable, "-m", "pdlab.cli", "serve", "--store", str(tmp_path / "lab.db"), "--port", str(port)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        try:
            for _ in range(600):
                if states(target) == {"done"}:
                    break
                assert server.poll() is None, "the server ended"
                time.sleep(0.1)
            assert states(target) == {"done"}
            urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5).close()
            assert answers(port, "127.0.0.1")
            assert answers(port, "localhost")
            assert not answers(port, "rebound.example"), "a web site whose name stands for 127.0.0.1"
            started = psutil.Process(server.pid).children(recursive=True)
            page, *_ = (one for one in started if "streamlit" in one.cmdline())
            assert not [region.path for region in page.memory_maps() if "llvmlite" in region.path]
            behind = [one.nice() - page.nice() for one in started if one != page and "runner" in one.cmdline()]
            assert behind == [15], "the page goes first"
        finally:
            server.terminate()
        said = server.communicate(timeout=60)[0]
    assert server.returncode == 0
    assert "the runner logs to" in said
    assert not [one for one in started if one.is_running() and one.status() != psutil.STATUS_ZOMBIE]
    log = (tmp_path / "lab.runner.log").read_text(encoding="utf-8")
    assert "prediction 1: done" in log
    assert "Traceback" not in log
    target.close()


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminal hangs up here")
def test_a_terminal_that_is_closed_ends_both(tmp_path: Path) -> None:
    port = free_port()
    command = ("serve", "--store", str(tmp_path / "lab.db"), "--port", str(port))
    with serving("pdlab.cli", *command, port=port, cwd=tmp_path, stdout=subprocess.DEVNULL) as server:
        started = psutil.Process(server.pid).children(recursive=True)
        assert len(started) >= 2
        for _ in range(2):  # the kernel tells the processes of a terminal, and the shell tells its own
            server.send_signal(signal.SIGHUP)
        code = server.wait(60)
    _, left = psutil.wait_procs(started, timeout=10)
    for one in left:
        one.kill()
    assert (code, left) == (0, [])
