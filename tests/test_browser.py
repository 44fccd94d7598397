"""A real headless Chromium enters a grading with a decimal comma, saves it, and it is in the store."""

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from pdlab import store as store_module
from pdlab.store import open_store

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync"]  # fmt: skip

if BROWSER is None and os.environ.get("PDLAB_REQUIRE_BROWSER") != "1":
    pytest.skip(f"no browser on the path (looked for {', '.join(NAMES)})", allow_module_level=True)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """``pdlab serve`` on a free port; ended as a user would end it."""
    port = free_port()
    command = [sys.executable, "-m", "pdlab.cli", "serve", "--store", str(tmp_path / "lab.db"), "--port", str(port)]
    server = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(240):
            assert server.poll() is None, "the server ended"
            try:
                urllib.request.urlopen(f"{address}/_stcore/health", timeout=1).close()
                break
            except OSError:
                time.sleep(0.25)
        yield address
    finally:
        server.terminate()
        server.wait(20)


def test_a_grading_entered_in_a_browser_is_found_in_the_store(served: str, tmp_path: Path) -> None:
    assert BROWSER is not None, f"PDLAB_REQUIRE_BROWSER=1 and no browser on the path ({', '.join(NAMES)})"
    from playwright.sync_api import expect, sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=FLAGS)
        page = browser.new_page(viewport={"width": 1400, "height": 1400})
        page.goto(f"{served}/new-aggregate")
        page.get_by_label("Name of the aggregate").fill("Kies 4/16")
        table = page.get_by_label("Sieve table")
        table.fill("31,5\t0\n16\t12o,5\n8\t800\n4\t79,5")
        table.press("Control+Enter")
        expect(page.get_by_text("'12o,5' is no number")).to_be_visible(timeout=20_000)
        table.fill("31,5\t0\n16\t120,5\n8\t800\n4\t79,5")
        table.press("Control+Enter")
        expect(page.get_by_text(re.compile(r"Equivalent diameter by the rule log_mean: \d+"))).to_be_visible(
            timeout=20_000
        )
        page.get_by_label("Value", exact=True).fill("1560,5")
        page.get_by_label("Particle density").fill("2601")
        page.get_by_label("Particle density").press("Enter")
        expect(page.get_by_text("0.6000")).to_be_visible(timeout=20_000)
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_text("saved: Kies 4/16")).to_be_visible(timeout=20_000)
        browser.close()
    opened = open_store(str(tmp_path / "lab.db"))
    with opened.read() as session:
        row = store_module.aggregates(session, ["Kies 4/16"])[0]
    opened.close()
    results = [(result.aperture_mm, result.retained_g) for result in row.sieve_analyses[0].results]
    assert results == [(31.5, 0.0), (16.0, 120.5), (8.0, 800.0), (4.0, 79.5)]
    assert row.packing_tests[0].bulk_density_kg_m3 == 1560.5
