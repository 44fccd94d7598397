"""Screenshots of every view of the page, wide and narrow, light and dark, into docs/screens.

``python tests/validation/screenshots.py [VIEW ...]`` fills a store in a temporary folder with the shipped
measurements and two aggregates more, answers the runs by the tests' formula (no engine), serves it and draws the views
in a headless Chromium.
It needs the extra ``test`` and a chromium; look at the pictures after it.
"""

import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from conftest import FormulaRunner  # noqa: E402
from test_browser import FLAGS, NAMES, free_port  # noqa: E402
from test_proportions import MixingRunner  # noqa: E402

from pdlab import experiments  # noqa: E402
from pdlab.experiments import Way  # noqa: E402
from pdlab.lab import SHIPPED  # noqa: E402
from pdlab.store import Store, open_store  # noqa: E402
from pdlab.tables import read_path  # noqa: E402

SCREENS = ROOT / "docs" / "screens"
SIZES = {"wide": (1280, 900), "narrow": (820, 1100)}
VIEWS = {
    "predicted-vs-measured": "predicted-vs-measured",
    "aggregates": "aggregates",
    "calibration": "calibration?aggregate=3",
    "out-of-reach": "calibration?aggregate=4",
    "new-aggregate": "new-aggregate?draft=1",
    "proportions": "proportions?sweep=1",
    "triangle": "proportions?sweep=2",
    "profiles": "proportions?sweep=3",
    "new-sweep": "proportions?aggregates=1,3",
}
COLOURS = 96
SANDS = {
    "aggregates.csv": "name,particle_density_kg_m3,density_basis\nSand 0/4,2640,oven_dry\nGravel 4/16,2610,oven_dry\n",
    "sieves.csv": "aggregate,aperture_mm,passing_percent\n" + "".join(
        f"{name},{aperture},{passing}\n"
        for name, table in {
            "Sand 0/4": ((8, 100), (4, 93), (2, 74), (1, 55), (0.5, 33), (0.25, 12), (0.125, 3)),
            "Gravel 4/16": ((31.5, 100), (16, 92), (8, 41), (4, 6), (2, 1)),
        }.items()
        for aperture, passing in table
    ),
    "packing_tests.csv": "material,compaction,bulk_density_kg_m3,repeats,standard_deviation\n"
    "Sand 0/4,loose,1240,3,12\nGravel 4/16,loose,1520,3,10\n",
}  # fmt: skip
DRAFT = {
    "texts": {
        "name": "Kies 8/16", "particle_density_kg_m3": "2650", "density_basis": "oven_dry", "kind": "retained_g",
        "sample_mass_g": "1000", "sieve_standard": "EN 933-1", "sieve_date": "2026-03-31",
    },
    "sieves": [["31,5", "0"], ["16", "120,5"], ["8", "8oo"], ["4", "79,5"]],
    "tests": [{"kind": "bulk_density_kg_m3", "value": "1560,5", "compaction": "loose", "repeats": "3"}],
}  # fmt: skip


def fill(target: Store, folder: Path) -> None:
    """Fill a store as a laboratory's first weeks would."""
    for name, text in SANDS.items():
        (folder / name).write_text(text, encoding="utf-8")
    experiments.register(target, read_path(SHIPPED))
    experiments.register(target, read_path(folder))
    experiments.save_draft(target, "aggregate", DRAFT)
    runner = FormulaRunner(target)
    experiments.calibrate(target, runner, ["Gravel 4/16"], Way("auto"))
    experiments.calibrate(target, runner, ["Sand 0/4"])
    experiments.predict(target, runner)
    pebbles, mixing = ["pebbles L", "pebbles M", "pebbles F"], MixingRunner(target)
    for names in (pebbles[::2], pebbles, [*pebbles, "Gravel 4/16"]):
        experiments.sweep_aggregates(target, mixing, names, Way("auto"))


@contextmanager
def served(url: str) -> Iterator[str]:
    """Serve a store on a free port."""
    port = free_port()
    command = [sys.executable, "-m", "pdlab.cli", "serve", "--store", url, "--port", str(port)]
    server = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL)
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
        server.wait(20)


def draw(page: Any, address: str, file: Path) -> None:
    """Open a view, wait until all of it is drawn, and keep its picture in few colours, all of the view's height."""
    page.goto(address)
    page.get_by_role("heading", level=1).wait_for()
    page.wait_for_timeout(2500)
    for box in page.get_by_test_id("stPlotlyChart").all():
        box.locator("svg.main-svg").first.wait_for(timeout=60_000)
    page.wait_for_timeout(500)
    width = page.viewport_size["width"]
    height = page.evaluate("document.querySelector('[data-testid=stMainBlockContainer]').scrollHeight")
    first = page.viewport_size["height"]
    page.set_viewport_size({"width": width, "height": max(first, height)})
    page.wait_for_timeout(1500)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS).save(file, optimize=True)
    page.set_viewport_size({"width": width, "height": first})


def main(names: list[str]) -> None:
    """Draw the views of these names, all of them without."""
    browser_path = next(path for name in NAMES if (path := shutil.which(name)))
    SCREENS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        target = open_store(str(Path(folder) / "lab.db"))
        fill(target, Path(folder))
        target.close()
        with served(target.url) as address:
            browser = play.chromium.launch(executable_path=browser_path, args=FLAGS)
            for scheme in ("light", "dark"):
                for size, (width, height) in SIZES.items():
                    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
                    for name in names or VIEWS:
                        draw(page, f"{address}/{VIEWS[name]}", SCREENS / f"{name}-{size}-{scheme}.png")
                    page.close()
            browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
