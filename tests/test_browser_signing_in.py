"""A real headless Chromium signs in at a provider, sees the page, and signs out again."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

from oidc import EMAIL, provider, secrets_toml
from servers import free_port, serving
from test_browser import BROWSER, FLAGS

from pdlab import experiments
from pdlab.lab import SHIPPED
from pdlab.store import open_store
from pdlab.tables import read_path


def test_signing_in_shows_the_page_and_signing_out_hides_it(tmp_path: Path) -> None:
    from playwright.sync_api import expect, sync_playwright

    assert BROWSER is not None
    opened = open_store(str(tmp_path / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    opened.close()
    port = free_port()
    address = f"http://127.0.0.1:{port}"
    (tmp_path / ".streamlit").mkdir()
    with provider() as trusted, sync_playwright() as play:
        (tmp_path / ".streamlit" / "secrets.toml").write_text(secrets_toml(trusted.issuer, address))
        verb = ("serve", "--no-runner", "--store", "lab.db", "--port", str(port), "--address", "0.0.0.0")
        how: dict[str, Any] = {"cwd": tmp_path, "env": {**os.environ, "HOME": str(tmp_path)}}
        with (
            (tmp_path / "said.txt").open("w") as file,
            serving("pdlab.cli", *verb, port=port, stdout=file, stderr=subprocess.STDOUT, **how),
        ):
            browser = play.chromium.launch(executable_path=BROWSER, args=FLAGS)
            page = browser.new_page()
            page.set_default_timeout(20_000)
            page.goto(f"{address}/mixtures?mixture=2")
            page.get_by_role("button", name="Sign in").wait_for()
            assert page.get_by_text("pebbles").count() == 0
            page.get_by_role("button", name="Sign in").click()
            expect(page.get_by_text(f"Signed in as {EMAIL}")).to_be_visible(timeout=20_000)
            page.wait_for_url(f"{address}/mixtures?mixture=2")  # what was asked for, not home
            expect(page.get_by_role("button", name="Predict", exact=True)).to_be_visible(timeout=20_000)
            page.goto(address)  # once
            page.wait_for_url(f"{address}/predicted-vs-measured")
            page.goto(f"{address}/aggregates")
            expect(page.get_by_text("Search by name")).to_be_visible(timeout=20_000)
            with page.expect_response(re.compile("/auth/logout")):  # which takes the cookie back
                page.get_by_role("button", name="Sign out").click()
            expect(page.get_by_role("button", name="Sign in")).to_be_visible(timeout=20_000)
            page.goto(f"{address}/aggregates")
            expect(page.get_by_role("button", name="Sign in")).to_be_visible(timeout=20_000)
            assert page.get_by_text("Search by name").count() == 0
            browser.close()
    said = (tmp_path / "said.txt").read_text(encoding="utf-8")
    assert "for who signs in" in said
    assert "Traceback" not in said
    assert trusted.refused == []
    assert {"/authorize", "/token", "/jwks"} <= set(trusted.asked)
