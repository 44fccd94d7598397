"""Screenshots of every view of the page, wide and narrow, light and dark, into docs/screens.

``python tests/validation/screenshots.py [VIEW ...]`` fills a store in a temporary folder with the shipped
measurements and three aggregates more, answers the runs by the tests' formula (no engine) but for one bed, which is
placed by geometry alone, serves it and draws the views in a headless Chromium. Beside it stand a large store of random
rows, an empty one and one that asks for a sign-in.
``python tests/validation/screenshots.py pdlab-demo.db`` draws the home page of the store that `pdlab demo` made, which
is simulated, as docs/page.png.
It needs the extra ``test`` and a chromium; look at the pictures after it.
"""

import io
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "benchmarks")]

from conftest import FormulaRunner  # noqa: E402
from oidc import secrets_toml  # noqa: E402
from servers import free_port, serving  # noqa: E402
from store_speed import build  # noqa: E402
from test_browser import FLAGS, NAMES  # noqa: E402
from test_proportions import MixingRunner  # noqa: E402

from pdlab import Lab, experiments  # noqa: E402
from pdlab.experiments import Way  # noqa: E402
from pdlab.lab import SHIPPED  # noqa: E402
from pdlab.store import Store, open_store  # noqa: E402
from pdlab.tables import read_path  # noqa: E402

SCREENS = ROOT / "docs" / "screens"
SIZES = {"wide": (1280, 900), "narrow": (820, 1100)}


class View(NamedTuple):
    """A view's address, the texts that are clicked at before it is drawn, and the store that it shows."""

    address: str
    clicks: tuple[str, ...] = ()
    store: str = "lab"


VIEWS = {
    "predicted-vs-measured": View("predicted-vs-measured"),
    "density": View("predicted-vs-measured", store="large"),
    "aggregates": View("aggregates"),
    "new-aggregate": View("new-aggregate?draft=1"),
    "calibration": View("calibration?aggregate=3"),
    "out-of-reach": View("calibration?aggregate=4"),
    "new-mixture": View("mixtures?parts=4,5&shares=38.5&name=Concrete+0/16"),
    "mixture": View("mixtures?mixture=4"),
    "bed": View("mixtures?mixture=2", clicks=("drop_and_roll", "Show the bed in three dimensions")),
    "corrections": View("corrections?aggregate=5"),
    "proportions": View("proportions?sweep=1"),
    "triangle": View("proportions?sweep=2"),
    "profiles": View("proportions?sweep=3"),
    "greeting": View("predicted-vs-measured", store="empty"),
    "sign-in": View("predicted-vs-measured", store="closed"),
}
LARGE = 0.12
"""Of the store of ``store_speed.py``: enough predictions for a density."""
PAGE = ROOT / "docs" / "page.png"
COLOURS = 64
HEIGHT = "document.querySelector('[data-testid=stMainBlockContainer]').scrollHeight"
SANDS = {
    "aggregates.csv": "name,particle_density_kg_m3,density_basis\nSand 0/4,2640,oven_dry\nGravel 4/16,2610,oven_dry\n"
    "Gravel 8/32,2620,oven_dry\n",
    "sieves.csv": "aggregate,aperture_mm,passing_percent\n" + "".join(
        f"{name},{aperture},{passing}\n"
        for name, table in {
            "Sand 0/4": ((8, 100), (4, 93), (2, 74), (1, 55), (0.5, 33), (0.25, 12), (0.125, 3)),
            "Gravel 4/16": ((31.5, 100), (16, 92), (8, 14), (4, 6), (2, 1)),
            "Gravel 8/32": ((63, 100), (31.5, 95), (16, 38), (8, 4)),
        }.items()
        for aperture, passing in table
    ),
    "packing_tests.csv": "material,compaction,bulk_density_kg_m3,repeats,standard_deviation,date\n"
    "Sand 0/4,loose,1240,3,12,2026-03-30\nGravel 4/16,loose,1520,3,10,2026-03-30\n"
    "Gravel 8/32,loose,1530,3,10,2026-03-31\nGravel 4/32 40:60,loose,1600,3,11,2026-04-02\n",
    "mixtures.csv": "mixture,aggregate,solid_volume_share\n"
    "Gravel 4/32 40:60,Gravel 4/16,0.4\nGravel 4/32 40:60,Gravel 8/32,0.6\n",
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
    experiments.correct(
        target, {"sieve_result:5/2": {"passing_percent": "41"}}, "Anna", "digits swapped, 41 on the sheet"
    )
    experiments.save_draft(target, "aggregate", DRAFT)
    runner = FormulaRunner(target)
    experiments.calibrate(target, runner, ["Gravel 4/16"], Way("auto"))
    experiments.calibrate(target, runner, ["Sand 0/4"])
    experiments.predict(target, runner)
    with Lab(target.url) as lab:
        lab.predict(["pebbles L+F 1:1"], method="drop_and_roll")
    pebbles, mixing = ["pebbles L", "pebbles M", "pebbles F"], MixingRunner(target)
    for names in (pebbles[::2], pebbles, [*pebbles, "Gravel 4/16"]):
        experiments.sweep_aggregates(target, mixing, names, Way("auto"))


def stores(folder: Path) -> dict[str, str]:
    """Fill the stores in folders of their own; return their addresses by name."""
    urls = dict[str, str]()
    for name in ("lab", "large", "empty", "closed"):
        own = folder / name
        own.mkdir()
        with closing(open_store(str(own / "lab.db"))) as target:
            if name == "lab":
                fill(target, own)
            elif name == "large":
                build(target, LARGE)
            urls[name] = target.url
    return urls


@contextmanager
def served(url: str, closed: bool) -> Iterator[str]:
    """Serve a store on a free port, to all on this machine or, ``closed``, to who signs in."""
    port, folder = free_port(), Path(url.removeprefix("sqlite:///")).parent
    address = f"http://127.0.0.1:{port}"
    if closed:
        (folder / ".streamlit").mkdir()
        (folder / ".streamlit" / "secrets.toml").write_text(secrets_toml("https://id.example", address))
    with serving(
        "pdlab.cli", "serve", "--store", url, "--port", str(port), "--no-runner",
        port=port, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL,
    ):  # fmt: skip
        yield address


def settle(page: Any) -> None:
    """Wait until all of a view is drawn."""
    page.wait_for_timeout(700)
    page.locator("[data-testid=stApp][data-test-script-state=notRunning]").wait_for(timeout=60_000)
    for box in page.get_by_test_id("stPlotlyChart").all():
        box.locator("svg.main-svg, canvas").first.wait_for(timeout=60_000)
    page.wait_for_timeout(700)


def draw(page: Any, address: str, clicks: Sequence[str], file: Path) -> None:
    """Open a view, wait until all of it is drawn, and keep its picture in few colours, all of the view's height."""
    page.goto(address)
    page.get_by_role("heading", level=1).wait_for()
    settle(page)
    for text in clicks:
        page.get_by_text(text).click()
        settle(page)
    width, first = page.viewport_size["width"], page.viewport_size["height"]
    height = 0
    while (now := max(first, page.evaluate(HEIGHT))) > height:  # what is drawn late makes it higher
        height = now
        page.set_viewport_size({"width": width, "height": height})
        settle(page)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=1).save(file, optimize=True)
    page.set_viewport_size({"width": width, "height": first})


def browser_path() -> str:
    """Return the path of a chromium."""
    return next(path for name in NAMES if (path := shutil.which(name)))


def main_demo(file: Path) -> None:
    """Draw the home page of a demo's store."""
    with sync_playwright() as play, served(f"sqlite:///{file.resolve()}", False) as address:
        browser = play.chromium.launch(executable_path=browser_path(), args=FLAGS)
        width, height = SIZES["wide"]
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="light")
        draw(page, f"{address}/predicted-vs-measured", (), PAGE)
        browser.close()


def main(names: list[str]) -> None:
    """Draw the views of these names, all of them without."""
    SCREENS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play, ExitStack() as servers:
        at = {name: servers.enter_context(served(url, name == "closed")) for name, url in stores(Path(folder)).items()}
        browser = play.chromium.launch(executable_path=browser_path(), args=FLAGS)
        for scheme in ("light", "dark"):
            for size, (width, height) in SIZES.items():
                page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
                for name in names or VIEWS:
                    view = VIEWS[name]
                    file = SCREENS / f"{name}-{size}-{scheme}.png"
                    draw(page, f"{at[view.store]}/{view.address}", view.clicks, file)
                page.close()
        browser.close()


if __name__ == "__main__":
    if sys.argv[1:] and Path(sys.argv[1]).suffix == ".db":
        main_demo(Path(sys.argv[1]))
    else:
        main(sys.argv[1:])
