"""How fast a browser shows the page of a large store, beside an otherwise empty page with one chart of 500 points.

``python tests/benchmarks/browser_speed.py [FILE]``: takes the store in FILE, or builds one of 100 000 runs and 10 000
mixtures there (in a temporary folder by default), serves it and the empty page, and opens both in a headless Chromium,
turn by turn. Times are medians of the rounds, in ms of the clock; what counts is the ratio to the empty page.
"""

import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from page_speed import filled
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))

from servers import free_port, serving
from test_browser import FLAGS, NAMES

EMPTY = """
import numpy as np
import plotly.graph_objects as go
import streamlit as st

st.set_page_config(page_title="empty", layout="wide")
st.title("Empty")
st.selectbox("Choice", range(200), key="choice")
x = np.linspace(0.0, 1.0, 500)
st.plotly_chart(go.Figure(go.Scatter(x=x, y=np.sin(9.0 * x + st.session_state.choice), mode="markers")), key="chart")
"""
ROUNDS, LIMIT = 15, 1.5
"""Times that each view is opened and each interaction done; how many times as long as the empty page they may take."""
WATCH = """() => {
  const app = document.querySelector('[data-testid=stApp]');
  const begin = performance.now();
  let last = begin;
  window.ended = null;
  const look = new MutationObserver((seen) => {
    if (seen.some(({target}) => !(target.closest ? target : target.parentElement)?.closest('canvas'))) {
      last = performance.now();
    }
  });
  const pen = CanvasRenderingContext2D.prototype;
  window.fillText ??= pen.fillText;
  pen.fillText = function (...texts) {
    if (app.contains(this.canvas)) last = performance.now();
    return window.fillText.apply(this, texts);
  };
  look.observe(app, {attributes: true, childList: true, characterData: true, subtree: true});
  const wait = setInterval(() => {
    const idle = app.getAttribute('data-test-script-state') === 'notRunning';
    if (!idle || last === begin || performance.now() - last < QUIET) return;
    look.disconnect();
    clearInterval(wait);
    window.ended = last - begin;
  }, 50);
}""".replace("QUIET", "800")
"""Notes how long it takes from now until the page has changed for the last time: until nothing does for 0.8 s.

What is drawn on a canvas counts when it is drawn; what a grid has for screen readers within its canvas, which nobody
sees and which follows 0.2 s later, does not.
"""
DRAWN = """(charts) => {
  const app = document.querySelector('[data-testid=stApp]');
  return app !== null && app.getAttribute('data-test-script-state') === 'notRunning'
    && document.querySelector('h1') !== null && document.querySelectorAll('.main-svg').length >= charts;
}"""


@dataclass(frozen=True)
class Step:
    """An interaction: the view that it is done on, what it is called, what a person does."""

    address: str
    name: str
    act: Callable[[Any], None]


def choose(label: str) -> Callable[[Any], None]:
    """Return how another entry of a selectbox is chosen."""

    def act(page: Any) -> None:
        box = page.get_by_role("combobox", name=label)
        now = box.input_value()
        box.click()
        options = page.get_by_role("option")
        options.first.wait_for()
        others = [text for text in options.all_inner_texts()[:5] if text != now]
        page.evaluate(WATCH)
        options.get_by_text(random.choice(others), exact=True).click()

    return act


def write(label: str, texts: tuple[str, ...]) -> Callable[[Any], None]:
    """Return how another text is written into a field."""

    def act(page: Any) -> None:
        field = page.get_by_role("textbox", name=label)
        now = field.input_value()
        field.fill(next(text for text in texts if text != now))
        page.evaluate(WATCH)
        field.press("Enter")

    return act


VIEWS = {
    "predicted-vs-measured": ("", 1),
    "aggregates": ("", 1),
    "calibration": ("", 1),
    "mixtures": ("?mixture=9990", 1),
    "proportions": ("?sweep=2", 1),
    "new-aggregate": ("", 0),
}
"""What stands behind a view's address, and how many charts it draws."""
STEPS = (
    Step("predicted-vs-measured", "another search", write("Search in mixtures", ("mix 00", "mix 01"))),
    Step("aggregates", "another search", write("Search", ("gravel 01", "gravel 02"))),
    Step("calibration", "another aggregate", choose("Aggregate")),
    Step("mixtures", "another mixture", choose("Mixture")),
    Step("proportions", "another sweep", choose("Sweep")),
    Step("new-aggregate", "another name", write("Name of the aggregate", ("A", "B"))),
)


def opened(page: Any, address: str, charts: int) -> float:
    """Open an address and return how long it takes until all is drawn [ms]."""
    page.goto("about:blank")
    begin = time.perf_counter()
    page.goto(address, wait_until="commit")
    page.wait_for_function(DRAWN, arg=charts)
    return 1e3 * (time.perf_counter() - begin)


def done(page: Any, step: Step) -> float:
    """Do an interaction and return how long it takes until the page is drawn again [ms]."""
    step.act(page)
    page.wait_for_function("window.ended !== null")
    return float(page.evaluate("window.ended"))


@contextmanager
def served(command: list[str], url: str = "") -> Iterator[str]:
    """Serve by a command on a free port."""
    port = free_port()
    place = ("--port", str(port)) if url else (f"--server.port={port}",)
    quiet = {"env": {**os.environ, "PDLAB_STORE": url}, "stdout": subprocess.DEVNULL}
    with serving(*command, *place, port=port, **quiet):
        yield f"http://127.0.0.1:{port}"


def compared(browsers: list[Any], address: str, empty: str) -> None:
    """Print how long each view and interaction takes beside the empty page, turn by turn."""
    page, beside = (one.new_page() for one in browsers)  # in one browser one would be hidden and draw no frames
    plain = Step("", "another choice", choose("Choice"))
    for view, (query, charts) in VIEWS.items():
        ours, theirs = [], []
        for _ in range(ROUNDS):
            theirs.append(opened(beside, empty, 1))
            ours.append(opened(page, f"{address}/{view}{query}", charts))
        said(f"first view of /{view}", ours, theirs)
        for step in (step for step in STEPS if step.address == view):
            ours, theirs = [], []
            for _ in range(ROUNDS):
                theirs.append(done(beside, plain))
                ours.append(done(page, step))
            said(f"/{view}: {step.name}", ours, theirs)
    page.close()
    beside.close()


def said(name: str, ours: list[float], theirs: list[float]) -> None:
    """Print a row of the table."""
    one, other = statistics.median(ours), statistics.median(theirs)
    mark = "" if one <= LIMIT * other else f"   above {LIMIT}"
    print(f"{one:8.0f} {other:8.0f} {one / other:6.2f}  {name}{mark}", flush=True)


def main(path: Path) -> None:
    """Build the store where there is none, and print the table."""
    target = filled(path)
    target.close()
    browser_path = next(found for name in NAMES if (found := shutil.which(name)))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        script = Path(folder) / "empty.py"
        script.write_text(EMPTY, encoding="utf-8")
        browsers = [play.chromium.launch(executable_path=browser_path, args=FLAGS) for _ in range(2)]
        quiet = ["--server.headless=true", "--browser.gatherUsageStats=false", "--server.fileWatcherType=none"]
        plain = ["streamlit", "run", str(script), "--server.address=127.0.0.1", "--client.toolbarMode=viewer", *quiet]
        with served(["pdlab.cli", "serve", "--no-runner"], target.url) as address, served(plain) as empty:
            compared(browsers, address, empty)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(place) / "lab.db")
