"""How fast a browser shows the page of a large store, beside an otherwise empty page with one chart of 500 points.

``python tests/benchmarks/browser_speed.py [FILE]``: takes the store in FILE, or builds one of 100 000 runs and 10 000
mixtures there (in a temporary folder by default), serves it and the empty page, and opens both in a headless Chromium,
turn by turn. ``--people N`` then lets N people use the page at once while a runner works out what they wish for.
Times are medians of the rounds, in ms of the clock; what counts is the ratio to the empty page in the same run.
"""

import argparse
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from page_speed import filled
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_browser import FLAGS, NAMES, free_port

from pdlab import experiments, store
from pdlab.experiments import Way

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
ROUNDS, PAUSE = 7, 2.0
"""Times that each view is opened and each interaction done; seconds that people think, on average."""
LIMIT, CROWDED = 1.5, 3.0
WATCH = """() => {
  const app = document.querySelector('[data-testid=stApp]');
  const begin = performance.now();
  let last = begin;
  window.ended = null;
  const look = new MutationObserver(() => { last = performance.now(); });
  look.observe(app, {attributes: true, childList: true, characterData: true, subtree: true});
  const wait = setInterval(() => {
    const idle = app.getAttribute('data-test-script-state') === 'notRunning';
    if (!idle || last === begin || performance.now() - last < QUIET) return;
    look.disconnect();
    clearInterval(wait);
    window.ended = last - begin;
  }, 50);
}""".replace("QUIET", "800")
"""Notes how long it takes from now until the page has changed for the last time: until nothing does for 0.8 s."""
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
    import urllib.request

    port = free_port()
    server = subprocess.Popen(
        [sys.executable, "-m", *command, *(["--port", str(port)] if url else [f"--server.port={port}"])],
        env={**os.environ, "PDLAB_STORE": url}, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        for _ in range(240):
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=1).close()
                break
            except OSError:
                time.sleep(0.25)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(30)


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


def person(endpoint: str, address: str, seconds: float, seed: int, times: dict[str, list[float]]) -> None:
    """Use the page for some seconds, with pauses to think, in a window of its own."""
    draw = random.Random(seed)
    with sync_playwright() as play:
        browser = play.chromium.connect_over_cdp(endpoint)
        page = browser.new_context().new_page()
        wrong = times["errors"]
        page.on("pageerror", lambda error: wrong.append(str(error)))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            view = draw.choice(list(VIEWS))
            query, charts = VIEWS[view]
            try:
                times[f"first view of /{view}"].append(opened(page, f"{address}/{view}{query}", charts))
                for step in (step for step in STEPS if step.address == view):
                    time.sleep(draw.expovariate(1.0 / PAUSE))
                    times[f"/{view}: {step.name}"].append(done(page, step))
            except Exception as error:
                wrong.append(f"{view}: {error}")
            wrong += page.get_by_test_id("stException").all_inner_texts()
            time.sleep(draw.expovariate(1.0 / PAUSE))
        browser.close()


def people(endpoint: str, address: str, count: int, seconds: float) -> dict[str, list[float]]:
    """Let people use the page at once; return their times [ms] by what they did, and what went wrong as ``errors``."""
    times: dict[str, list[float]] = {"errors": []} | {f"first view of /{view}": [] for view in VIEWS}
    times |= {f"/{step.address}: {step.name}": [] for step in STEPS}
    threads = [threading.Thread(target=person, args=(endpoint, address, seconds, k, times)) for k in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return times


def crowded(endpoint: str, url: str, count: int, seconds: float) -> None:
    """Print how much longer people wait when so many are there at once and the runner works than one alone."""
    with served(["pdlab.cli", "serve", "--no-runner"], url) as address:
        people(endpoint, address, 1, 0.2 * seconds)
        alone = people(endpoint, address, 1, seconds)
    target = store.open_store(url)
    experiments.ask_predictions(target, experiments.to_predict(target, ())[:200], Way(seeds=8), 0)
    target.close()
    with served(["pdlab.cli", "serve"], url) as address:
        psutil.cpu_percent()
        together = people(endpoint, address, count, seconds)
        print(f"processor {psutil.cpu_percent():.0f} % busy; {len(together['errors'])} errors in {seconds:.0f} s")
    for sentence in alone.pop("errors") + together.pop("errors"):
        print(f"  {sentence.splitlines()[0]}")
    for name, ours in together.items():
        if ours and alone[name]:
            one, other = statistics.median(ours), statistics.median(alone[name])
            mark = "" if one <= CROWDED * other else f"   above {CROWDED}"
            print(f"{one:8.0f} {other:8.0f} {one / other:6.2f}  {name} ({len(ours)} times){mark}", flush=True)


def main(path: Path, count: int, seconds: float) -> None:
    """Build the store where there is none, and print the tables."""
    target = filled(path)
    target.close()
    browser_path = next(found for name in NAMES if (found := shutil.which(name)))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        script, port = Path(folder) / "empty.py", free_port()
        script.write_text(EMPTY, encoding="utf-8")
        flags = [*FLAGS, f"--remote-debugging-port={port}"]
        browser = play.chromium.launch(executable_path=browser_path, args=flags)
        beside = play.chromium.launch(executable_path=browser_path, args=FLAGS)
        if count:
            crowded(f"http://127.0.0.1:{port}", target.url, count, seconds)
            return
        quiet = ["--server.headless=true", "--browser.gatherUsageStats=false", "--server.fileWatcherType=none"]
        plain = ["streamlit", "run", str(script), "--server.address=127.0.0.1", "--client.toolbarMode=viewer", *quiet]
        with served(["pdlab.cli", "serve", "--no-runner"], target.url) as address, served(plain) as empty:
            compared([browser, beside], address, empty)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--people", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        main(asked.file or Path(place) / "lab.db", asked.people, asked.seconds)
