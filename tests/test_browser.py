"""A real headless Chromium: a grid that is typed and pasted into, a file; what survives; a report."""

import io
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
from conftest import FormulaPool, FormulaRunner
from PIL import Image
from servers import free_port, serving
from test_proportions import MixingRunner

from pdlab import Lab, experiments
from pdlab import store as store_module
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer
from pdlab.charts.parity import CROWDED
from pdlab.lab import SHIPPED
from pdlab.models import Mixture, MixtureComponent, PackingTest
from pdlab.page.app import CORRECTIONS, HOME, VIEWS
from pdlab.page.mixture_tests import ENTER
from pdlab.page.new_aggregate import KIND
from pdlab.store import open_store
from pdlab.tables import read_path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync"]  # fmt: skip

if BROWSER is None and os.environ.get("PDLAB_REQUIRE_BROWSER") != "1":
    pytest.skip(f"no browser on the path (looked for {', '.join(NAMES)})", allow_module_level=True)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One browser for all tests; each has a context, and so cookies and a cache, of its own."""
    assert BROWSER is not None, f"PDLAB_REQUIRE_BROWSER=1 and no browser on the path ({', '.join(NAMES)})"
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def serve(folder: Path) -> Iterator[str]:
    """``pdlab serve`` of a store in a folder, on a free port; ended as a user would end it."""
    port, store = free_port(), str(folder / "lab.db")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with serving(
        "pdlab.cli", "serve", "--no-runner", "--store", store, "--port", str(port), port=port, cwd=folder, **quiet
    ):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """The address of a store of the test's own, empty at first."""
    with serve(tmp_path) as address:
        yield address


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of an empty store, for tests that save nothing but drafts."""
    with serve(tmp_path_factory.mktemp("empty")) as address:
        yield address


@pytest.fixture(scope="module")
def stocked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a store with the shipped measurements, predictions and one draft, for tests that save nothing."""
    folder = tmp_path_factory.mktemp("stocked")
    opened = open_store(str(folder / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    experiments.predict(opened, FormulaRunner(opened))
    experiments.save_draft(opened, KIND, {"texts": {"name": "Kies 4/16"}, "sieves": [], "tests": []})
    opened.close()
    with serve(folder) as address:
        yield address


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page of a browser's window, whose clipboard may be used."""
    context = browser.new_context(viewport={"width": 1400, "height": 1400})
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    opened = context.new_page()
    opened.set_default_timeout(20_000)
    yield opened
    context.close()


def cell(page: Any, row: int, column: int) -> None:
    """Click at a cell of the grid, once it stands: two columns beside the mark of the row, rows of 35 pixels."""
    page.wait_for_timeout(700)
    box = page.get_by_test_id("stDataFrame").first.bounding_box()
    left = 40 + (box["width"] - 40) * (0.25 + 0.5 * column)
    place = box["x"] + left, box["y"] + 35 * (row + 1.5)
    page.mouse.move(*place, steps=3)  # a grid takes no click where no mouse has come
    page.mouse.click(*place)


def type_cell(page: Any, row: int, column: int, text: str) -> None:
    editor = page.get_by_test_id("portal").locator("input,textarea")
    for _ in range(4):  # a grid that is drawn anew meanwhile closes its editor
        cell(page, row, column)
        page.keyboard.press("Enter")
        page.wait_for_timeout(300)
        if editor.count():
            break
    editor.fill(text)
    page.keyboard.press("Enter")


def test_a_grading_typed_pasted_and_reloaded_in_a_browser_is_found_in_the_store(
    page: Any, served: str, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    page.goto(f"{served}/new-aggregate")
    page.get_by_label("Name of the aggregate").fill("Kies 4/16")
    page.get_by_label("Name of the aggregate").press("Enter")
    page.wait_for_url(re.compile("draft="))  # what is drawn above the grid stands
    page.wait_for_timeout(500)
    page.evaluate("navigator.clipboard.writeText('31,5\\t0\\n16\\t12o,5\\n8\\t800\\n4\\t79,5')")
    cell(page, 0, 0)
    page.keyboard.press("Control+V")
    expect(page.get_by_text("'12o,5' is no number")).to_be_visible(timeout=20_000)
    page.wait_for_timeout(500)
    page.reload()
    expect(page.get_by_text("'12o,5' is no number")).to_be_visible(timeout=20_000)
    expect(page.get_by_label("Name of the aggregate")).to_have_value("Kies 4/16")
    type_cell(page, 1, 1, "120,5")
    diameter = re.compile(r"Equivalent diameter by the rule log_mean: \d+")
    expect(page.get_by_text(diameter)).to_be_visible(timeout=20_000)
    page.get_by_label("Value [kg/m³]", exact=True).fill("1560,5")
    page.get_by_role("textbox", name="Particle density").fill("2601")
    page.get_by_role("textbox", name="Particle density").press("Enter")
    expect(page.get_by_text("0.6000 ±")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("saved: Kies 4/16")).to_be_visible(timeout=20_000)
    opened = open_store(str(tmp_path / "lab.db"))
    with opened.read() as session:
        row = store_module.aggregates(session, ["Kies 4/16"])[0]
    opened.close()
    results = [(result.aperture_mm, result.retained_g) for result in row.sieve_analyses[0].results]
    assert results == [(31.5, 0.0), (16.0, 120.5), (8.0, 800.0), (4.0, 79.5)]
    assert row.sieve_analyses[0].results[1].raw_text == "16\t120,5"
    assert row.packing_tests[0].bulk_density_kg_m3 == 1560.5


def test_the_entrance_leads_home_by_its_own_address(page: Any, empty: str) -> None:
    page.goto(empty)
    page.wait_for_url(re.compile("/predicted-vs-measured$"))
    page.get_by_text("The store holds no mixture yet").wait_for()
    page.reload()
    page.get_by_text("The store holds no mixture yet").wait_for()
    assert page.get_by_text("Page not found").count() == 0


def test_a_view_finds_its_server_at_once_below_a_path_of_a_proxy_too(page: Any, tmp_path: Path) -> None:
    port, store = free_port(), str(tmp_path / "lab.db")
    how: dict[str, Any] = {"cwd": tmp_path, "env": {**os.environ, "STREAMLIT_SERVER_BASE_URL_PATH": "lab"}}
    verb = ("serve", "--no-runner", "--store", store, "--port", str(port))
    asked = list[str]()
    page.on("request", lambda request: asked.append(request.url))
    with serving("pdlab.cli", *verb, port=port, below="lab/", **how):
        page.goto(f"http://127.0.0.1:{port}/lab/aggregates")
        page.get_by_role("heading", name="Aggregates").wait_for()
    assert [url for url in asked if url.endswith("_stcore/health")] == [f"http://127.0.0.1:{port}/lab/_stcore/health"]
    assert any("PlotlyChart" in url for url in asked)


def test_on_a_tablet_s_bar_all_views_are_at_hand(page: Any, empty: str) -> None:
    page.set_viewport_size({"width": 768, "height": 1024})
    page.goto(f"{empty}/aggregates")
    for name in ("Home", *(title for address, (title, _) in VIEWS.items() if address not in (HOME, CORRECTIONS))):
        page.get_by_test_id("stTopNavLink").get_by_text(name, exact=True).wait_for()


def test_a_file_and_then_a_cell_in_a_browser_fill_the_grid(page: Any, empty: str) -> None:
    from playwright.sync_api import expect

    page.goto(f"{empty}/new-aggregate")
    page.get_by_text("Fill from a text or a file").click()
    content = b"aggregate;aperture_mm;passing_percent\nS;4;100\nS;2;40,5\nS;1;2\n"
    page.get_by_test_id("stFileUploader").locator("input").set_input_files(
        {"name": "sand.csv", "mimeType": "text/csv", "buffer": content}
    )
    shown = page.get_by_test_id("stTable")
    expect(shown.get_by_text("40.5", exact=True).first).to_be_visible(timeout=20_000)
    type_cell(page, 1, 1, "12,5")
    expect(shown.get_by_text("12.5", exact=True).first).to_be_visible(timeout=20_000)
    type_cell(page, 1, 1, "13,5")  # a second edit of the same cell
    expect(shown.get_by_text("13.5", exact=True).first).to_be_visible(timeout=20_000)


def test_a_prediction_survives_a_closed_tab_and_comes_without_disturbing_what_is_typed(
    page: Any, served: str, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    opened = open_store(str(tmp_path / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    page.goto(f"{served}/mixtures?mixture=2")
    page.get_by_role("button", name="Predict", exact=True).click()
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    address, again = page.url, page.context.new_page()
    page.close()
    again.goto(address)
    expect(again.get_by_text("1st in line: it begins when a runner is free")).to_be_visible(timeout=20_000)
    again.get_by_role("textbox", name="Largest size D").press_sequentially("31,")
    waiting = experiments.waiting_prediction(opened, 2)
    assert waiting is not None
    runner = Runner(opened, FormulaPool())
    list(answer(runner, [waiting.key]))
    runner.close()
    opened.close()
    expect(again.get_by_text("Voids for paste [L/m³]")).to_be_visible(timeout=20_000)
    expect(again.get_by_role("textbox", name="Largest size D")).to_have_value("31,")


def test_every_view_is_drawn_without_the_engine_and_the_bed_in_three_dimensions_is_not_blank(
    page: Any, served: str, tmp_path: Path
) -> None:
    with Lab(str(tmp_path / "lab.db")) as lab:
        lab.import_tables(SHIPPED)
        lab.predict(method="drop_and_roll")
    for address in VIEWS:
        page.goto(f"{served}/{address}")
        page.get_by_role("heading", level=1, name=VIEWS[address][0]).wait_for()
        page.locator("[data-testid=stApp][data-test-script-state=notRunning]").wait_for()
        assert page.get_by_test_id("stException").count() == 0
    page.goto(f"{served}/mixtures?mixture=1")
    page.get_by_text("Show the bed in three dimensions").click()
    canvas = page.locator(".gl-container canvas").first
    canvas.wait_for()
    for _ in range(40):
        page.wait_for_timeout(250)
        drawn = Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")
        if len(drawn.getcolors(1 << 24) or []) > 500:
            break
    else:
        pytest.fail("nothing is drawn")
    port = f"--server.port={served.rsplit(':', 1)[1]}"
    (server,) = [
        one for one in psutil.process_iter(["cmdline"]) if {"streamlit", port} <= set(one.info["cmdline"] or ())
    ]
    assert not [region.path for region in server.memory_maps() if "llvmlite" in region.path]


def test_a_report_is_downloaded_and_printed_on_pages_of_a4_without_a_network(
    page: Any, stocked: str, tmp_path: Path
) -> None:
    page.goto(f"{stocked}/mixtures?mixture=2")
    with page.expect_download(timeout=20_000) as arriving:
        page.get_by_role("button", name="Download the report").click()
    assert arriving.value.suggested_filename == "report-pebbles-L+F-1-1.html"
    file = tmp_path / "report.html"
    arriving.value.save_as(file)
    page.context.set_offline(True)
    said, asked = list[str](), list[str]()
    page.on("console", lambda message: said.append(message.text))
    page.on("request", lambda request: asked.append(request.url.partition(":")[0]))
    page.goto(file.as_uri())
    assert page.get_by_role("heading", level=1).inner_text() == "Mixture pebbles L+F 1:1"
    assert page.evaluate("[...document.images].map(one => one.naturalWidth > 100)") == [True] * 4
    assert set(asked) <= {"file", "data"}
    assert said == []
    printed = page.pdf(prefer_css_page_size=True)
    (sheets,) = {tuple(float(side) for side in box.split()) for box in re.findall(rb"/MediaBox \[([^\]]*)\]", printed)}
    assert sheets == pytest.approx((0.0, 0.0, 595.3, 841.9), abs=1.0)
    assert b"/Title (Mixture pebbles L+F 1:1" in printed


def test_a_click_on_a_point_opens_its_mixture_and_the_way_back_keeps_the_filters(page: Any, stocked: str) -> None:
    from playwright.sync_api import expect

    page.goto(f"{stocked}/predicted-vs-measured?find=m%2B")
    point = page.locator(".scatterlayer .points path")
    expect(page.get_by_text("Mean absolute error of monosized, 1 mixture")).to_be_visible(timeout=20_000)
    point.wait_for()
    page.wait_for_timeout(500)
    place = point.bounding_box()
    x, y = (place[at] + place[size] / 2.0 for at, size in (("x", "width"), ("y", "height")))
    page.mouse.move(x, y, steps=3)
    expect(page.locator(".hoverlayer")).to_contain_text("pebbles M+F 1:1")
    page.mouse.click(x, y)
    page.wait_for_url(re.compile(r"/mixtures\?mixture=3$"))
    page.go_back()
    page.wait_for_url(re.compile(r"/predicted-vs-measured\?find=m%2B$"))
    expect(page.get_by_label("Search in mixtures")).to_have_value("m+")


def test_points_of_a_crowd_are_found_by_the_mouse_though_they_are_one_picture(
    page: Any, served: str, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    opened = open_store(str(tmp_path / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    with opened.write() as session:
        for k in range(CROWDED):
            mixture = Mixture(name=f"mix {k}")
            shares = ((1, 0.25 + 0.005 * k), (2, 0.75 - 0.005 * k))
            mixture.components = [
                MixtureComponent(aggregate_id=key, solid_volume_share=share, position=at)
                for at, (key, share) in enumerate(shares)
            ]
            mixture.packing_tests = [PackingTest(compaction="loose", voids_percent=40.0 - 0.05 * k, raw_text="")]
            session.add(mixture)
    experiments.predict(opened, FormulaRunner(opened))
    opened.close()
    page.goto(f"{served}/predicted-vs-measured?find=mix")
    expect(page.get_by_text(f"{CROWDED} mixtures")).to_be_visible(timeout=20_000)
    page.locator(".js-plotly-plot .layer-above image, .js-plotly-plot .imagelayer image").first.wait_for()
    box = page.locator(".nsewdrag").bounding_box()
    x, y = page.evaluate("""() => {
      const drawn = document.querySelector('.js-plotly-plot');
      const {xaxis, yaxis} = drawn._fullLayout;
      const series = drawn.calcdata.at(-1);
      return [xaxis.d2p(series[40].x), yaxis.d2p(series[40].y)];
    }""")
    page.locator('[data-title="Box Select"]').click()
    page.mouse.move(box["x"] + 2, box["y"] + 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] - 2, box["y"] + box["height"] - 2, steps=5)
    page.mouse.up()
    expect(page.get_by_text(f"{CROWDED} picked")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Show the newest again").click()
    expect(page.get_by_text("Newest predictions")).to_be_visible(timeout=20_000)
    expect(page.locator(".js-plotly-plot")).to_have_count(1, timeout=20_000)
    page.locator('[data-title="Pan"]').click()
    page.mouse.move(box["x"] + x, box["y"] + y, steps=3)
    expect(page.locator(".hoverlayer")).to_contain_text("mix 40")
    page.mouse.click(box["x"] + x, box["y"] + y)
    page.wait_for_url(re.compile(r"/mixtures\?mixture="))
    expect(page.get_by_role("combobox", name="Mixture")).to_have_value("mix 40", timeout=20_000)


def test_the_way_back_from_another_view_shows_what_was_chosen(page: Any, served: str, tmp_path: Path) -> None:
    opened = open_store(str(tmp_path / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    experiments.sweep_aggregates(opened, MixingRunner(opened), ["pebbles L", "pebbles F"])
    opened.close()
    page.goto(f"{served}/proportions?sweep=1")
    page.get_by_role("button", name="Put the densest mix together").click()
    page.wait_for_url(re.compile(r"/mixtures\?parts="))
    page.get_by_label("Name of the mixture").wait_for()
    page.go_back()
    page.wait_for_url(re.compile(r"/proportions\?sweep=1$"))
    page.get_by_role("button", name="Put the densest mix together").wait_for()
    page.goto(f"{served}/mixtures?mixture=2")
    page.get_by_role("button", name="Predict", exact=True).wait_for()
    page.get_by_role("link", name="Calibration").first.click()
    page.wait_for_url(re.compile(r"/calibration\?aggregate="))
    page.get_by_role("button", name="Calibrate", exact=True).wait_for()
    page.wait_for_timeout(1000)
    for _ in range(2):  # a step for the view and, where its address comes later, one for that
        page.go_back()
        page.wait_for_timeout(2000)
        if "/mixtures" in page.url:
            break
    page.wait_for_url(re.compile(r"/mixtures\?mixture=2$"))


def test_a_mixtures_density_test_is_entered_reloaded_saved_and_corrected_twice_in_a_browser(
    page: Any, served: str, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    opened = open_store(str(tmp_path / "lab.db"))
    experiments.register(opened, read_path(SHIPPED))
    page.goto(f"{served}/mixtures?mixture=2")
    page.get_by_text(ENTER).click()
    page.get_by_label("Value [kg/m³]").wait_for()
    page.locator("[data-testid=stApp][data-test-script-state=notRunning]").wait_for()
    page.get_by_label("Value [kg/m³]").fill("35,2")
    page.get_by_label("Value [kg/m³]").press("Tab")
    page.wait_for_url(re.compile("test=of%3D2"))
    page.reload()
    expect(page.get_by_label("Value [kg/m³]")).to_have_value("35,2")
    page.get_by_role("combobox", name="Measured").click()
    page.get_by_role("option", name="voids", exact=True).click()
    expect(page.get_by_text("0.6480 ±")).to_be_visible()
    page.get_by_role("button", name="Save the density test").click()
    expect(page.get_by_text("saved: a density test of pebbles L+F 1:1")).to_be_visible()
    expect(page.get_by_role("button", name="Save the density test")).to_have_count(0)  # a further one is another form
    page.get_by_text("Correct what was entered of this mixture").click()
    for text, before in (("35,3", "35.2"), ("35,4", "35.3")):
        expect(page.get_by_label("Value [%]")).to_have_value(before)
        page.get_by_label("Value [%]").fill(text)
        page.get_by_label("Who corrects").fill("Anna")
        page.get_by_label("Why").fill("misread")
        page.get_by_label("Why").press("Tab")
        expect(page.get_by_role("cell", name=text)).to_be_visible()
        page.get_by_role("button", name="Save the correction").click()
        expect(page.get_by_text(f"corrected: Voids [%] {before} → {text.replace(',', '.')}")).to_be_visible()
        page.locator("[data-testid=stApp][data-test-script-state=notRunning]").wait_for()
    (test, *_) = experiments.recorded(opened, "mixture", 2).records
    opened.close()
    assert (test.texts["value"], test.version) == ("35.4", 3)


HELD = re.compile(r"/(Selectbox|TextInput|Multiselect|Radio)\.[^/]*\.js$")
FILLED = [  # an address, what is pressed at once, a text that stood there and is to stand there still
    ("new-aggregate?draft=1", "Add a density test", "Name of the aggregate", "Kies 4/16"),
    ("mixtures?parts=1,2&shares=62.5", "Save the mixture", "pebbles L [%]", "62.5"),  # which has no name yet
    ("mixtures?mixture=2&test=of%3D2%26value%3D35.2", "Save the density test", "Value [kg/m³]", "35.2"),
]


def test_what_is_pressed_before_the_browser_has_loaded_the_form_empties_nothing(page: Any, stocked: str) -> None:
    from playwright.sync_api import expect

    held = list[Any]()

    def hold(route: Any) -> None:
        held.append(route)

    page.route(HELD, hold)
    for address, pressed, label, text in FILLED:
        page.goto(f"{stocked}/{address}")
        page.get_by_role("button", name=pressed).click()
        page.wait_for_timeout(1500)
        assert page.get_by_label(label).count() == 0, "the form was there already"
        while held:
            held.pop().continue_()
        expect(page.get_by_label(label)).to_have_value(text)
        page.get_by_label(label).press("Enter")
        page.wait_for_timeout(1500)
        expect(page.get_by_label(label)).to_have_value(text)


def test_back_and_forward_within_a_view_show_what_the_address_says(page: Any, stocked: str) -> None:
    from playwright.sync_api import expect

    page.goto(f"{stocked}/mixtures?parts=1,2&shares=62.5")
    name, chosen = page.get_by_label("Name of the mixture"), page.get_by_role("combobox", name="Mixture", exact=True)
    name.fill("Mine")
    name.press("Enter")
    page.wait_for_url(re.compile("name=Mine"))
    chosen.click()
    page.get_by_role("option", name="pebbles L+F 1:1").click()
    page.wait_for_url(re.compile(r"\?mixture=2$"))
    page.get_by_text(ENTER).click()
    page.get_by_label("Value [kg/m³]").fill("1600")
    page.get_by_label("Value [kg/m³]").press("Enter")
    page.wait_for_url(re.compile("value%3D1600"))
    page.go_back()
    expect(page.get_by_label("Value [kg/m³]")).to_have_value("")
    page.go_forward()
    expect(page.get_by_label("Value [kg/m³]")).to_have_value("1600")
    page.go_back()
    page.go_back()
    expect(name).to_have_value("Mine")
    page.go_back()
    expect(name).to_have_value("")
    expect(page.get_by_label("pebbles L [%]")).to_have_value("62.5")
    page.go_forward()
    expect(name).to_have_value("Mine")
    page.go_forward()
    expect(chosen).to_have_value("pebbles L+F 1:1")
    page.goto(f"{stocked}/predicted-vs-measured")
    page.get_by_label("Search in mixtures").fill("L+M")
    page.get_by_label("Search in mixtures").press("Enter")
    page.wait_for_url(re.compile("find="))
    page.go_back()
    expect(page.get_by_label("Search in mixtures")).to_have_value("")
