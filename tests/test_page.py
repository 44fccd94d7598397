"""The page by AppTest: what is typed is parsed, checked beside its row, and kept whole or not at all."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
import streamlit as st
from conftest import FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash

import pdlab
from pdlab import experiments
from pdlab import store as store_module
from pdlab.errors import StoreAway
from pdlab.experiments import AGGREGATE_TEXTS, SIEVE_TEXTS
from pdlab.lab import SHIPPED
from pdlab.page import aggregates, sieve_table
from pdlab.page.app import HOME, VIEWS
from pdlab.page.wording import digits
from pdlab.store import Store, open_store
from pdlab.tables import read_path

PAGE = Path(pdlab.__file__).with_name("page") / "app.py"


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Store]:
    url = f"sqlite:///{tmp_path / 'lab.db'}"
    monkeypatch.setenv("PDLAB_STORE", url)
    st.cache_resource.clear()
    opened = open_store(url)
    yield opened
    opened.close()


def page(address: str = "", script: Path = PAGE) -> AppTest:
    app = AppTest.from_file(str(script), default_timeout=60)
    app._page_hash = calc_hash(address) if address else ""  # switch_page knows views that are files alone
    app.run()
    assert not app.exception
    return app


def form(draft: str = "") -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("new-aggregate")
    if draft:
        app.query_params["draft"] = draft
    app.run()
    assert not app.exception
    return app


def grid(app: AppTest, text: str) -> AppTest:
    """Type a sieve table into the grid, cell by cell."""
    edits = {k: dict(zip(("sieve", "value"), line.split(), strict=False)) for k, line in enumerate(text.splitlines())}
    key = f"sieves_{app.session_state[sieve_table.TURN]}"
    base = len(app.session_state[sieve_table.BASE])
    app.session_state[key] = {
        "edited_rows": {k: row for k, row in edits.items() if k < base},
        "added_rows": [row for k, row in edits.items() if k >= base],
        "deleted_rows": [],
    }
    return app


def type_in(app: AppTest, sieves: str = "", **texts: str) -> AppTest:
    if sieves:
        grid(app, sieves)
    for key, text in texts.items():
        app.text_input(key=key if key in AGGREGATE_TEXTS + SIEVE_TEXTS else f"test_0_{key}").set_value(text)
    app.run()
    assert not app.exception
    return app


def plain(app: AppTest) -> tuple[list[str], list[str]]:
    """What stands beside the rows of the sieve table, and below it, without Markdown's escapes."""
    tables = [table.value for table in app.table if "what is wrong" in table.value]
    rows = [text.replace("\\", "") for table in tables for text in table["what is wrong"]]
    return rows, [error.value.replace("\\", "") for error in app.error]


def save(app: AppTest) -> AppTest:
    app.button(key="save").click().run()
    assert not app.exception
    return app


def stored(lab: Store) -> list[str]:
    with lab.read() as session:
        return [row.name for row in store_module.aggregates(session)]


def test_a_value_that_is_missing_is_no_none_in_the_list_of_aggregates(lab: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nbare\n")
    experiments.register(lab, read_path(tmp_path / "aggregates.csv"))
    (shelf,) = page("aggregates").dataframe
    assert shelf.value.iloc[0].isna().any()
    assert shelf.proto.placeholder == "–"


def test_a_density_tests_value_has_the_unit_of_what_was_measured_and_keeps_what_is_typed(lab: Store) -> None:
    app = type_in(form(), value="39,5")
    units = []
    for kind in ("bulk_density_kg_m3", "voids_percent", "packing_density"):
        app.selectbox(key="test_0_kind").set_value(kind).run()
        assert app.text_input(key="test_0_value").value == "39,5"
        units.append((app.text_input(key="test_0_value").label, app.text_input(key="test_0_standard_deviation").label))
    assert units == [
        ("Value [kg/m³]", "Deviation [kg/m³]"), ("Value [%]", "Deviation [%]"), ("Value", "Deviation"),
    ]  # fmt: skip


def test_nothing_stands_on_the_page_by_itself(lab: Store) -> None:
    experiments.register(lab, read_path(SHIPPED))
    assert not page().markdown, "such as a constant's docstring"


@pytest.mark.parametrize("script", [PAGE, Path(__file__).parent.parent / "app.py"], ids=["pdlab serve", "app.py"])
def test_both_doors_lead_to_the_same_views(lab: Store, script: Path) -> None:
    assert [page(address, script).title[0].value for address in ("", *VIEWS)] == [
        VIEWS[HOME][0], *(title for title, _ in VIEWS.values()),
    ]  # fmt: skip


def test_the_tabulator_leads_from_the_name_to_the_particle_density_without_a_help_between(lab: Store) -> None:
    first = [box for box in form().text_input if box.key in ("name", "delivery", "particle_density_kg_m3")]
    assert [box.help for box in first] == ["", "", ""]


def test_a_grading_with_decimal_commas_is_saved_with_its_test(lab: Store) -> None:
    app = type_in(form(), name="Gravel 4/16", sieves="31,5\t0\n16\t120,5\n8\t800\n4\t79,5", sample_mass_g="1000")
    app.selectbox(key="test_0_compaction").set_value("loose")
    type_in(app, value="1560,5", particle_density_kg_m3="2601", repeats="3", standard_deviation="10,0")
    assert [metric.value for metric in app.metric] == ["0.6000 ± 0.0022", "40.0"]
    save(app)
    assert any("saved: Gravel 4/16; next, calibrate it" in message.value.replace("\\", "") for message in app.success)
    with lab.read() as session:
        row = store_module.aggregates(session)[0]
    results = row.sieve_analyses[0].results
    assert [(result.aperture_mm, result.retained_g) for result in results] == [
        (31.5, 0.0), (16.0, 120.5), (8.0, 800.0), (4.0, 79.5),
    ]  # fmt: skip
    assert results[0].raw_text == "31,5\t0"
    assert row.packing_tests[0].bulk_density_kg_m3 == 1560.5
    assert row.packing_tests[0].repeats == 3


def test_every_error_stands_beside_its_row_and_nothing_is_saved(lab: Store) -> None:
    app = type_in(form(), name="Gravel", sieves="31,5 0\nsixteen 120\n8 eighty")
    parsed = plain(app)[0]
    assert [text[:25] for text in parsed] == ["", "'sixteen' is no number; w", "'eighty' is no number; wr"]
    save(app)
    assert any("not saved" in error.value for error in app.error)
    assert stored(lab) == []


@pytest.mark.parametrize(
    ("sieves", "mass", "message"),
    [
        ("16 0\n8 5\n8 5", "", "aperture 8 mm stands twice"),
        ("16 0\n-8 5", "", "aperture -8 mm must be above 0"),
        ("16 5\n8 5", "", "50 % lie on the coarsest sieve"),
        ("16 0\n8 95", "100", "off the sample mass of 100 g"),
        ("16 0\n8 95", "much", "sample mass: 'much' is no number"),
        ("16 0\n8 80\npan 20", "", "20 % fell into the pan"),
    ],
)
def test_a_table_that_is_no_grading_is_named(lab: Store, sieves: str, mass: str, message: str) -> None:
    app = type_in(form(), name="G", sieves=sieves, sample_mass_g=mass)
    rows, errors = plain(app)
    assert any(message in text for text in rows + errors), (rows, errors)
    assert stored(save_and_get(app, lab)) == []


def save_and_get(app: AppTest, lab: Store) -> Store:
    save(app)
    return lab


def test_a_density_outside_0_and_1_is_named(lab: Store) -> None:
    app = type_in(form(), name="G", sieves="16 0\n8 100", value="2700", particle_density_kg_m3="2600")
    assert any("outside (0, 1)" in text for text in plain(app)[1])
    assert stored(save_and_get(app, lab)) == []


def test_what_is_wrong_with_the_aggregate_is_said_once_and_before_its_density_test(lab: Store) -> None:
    app = type_in(form(), name="G", sieves="16 0\n8 100", value="1500", particle_density_kg_m3="2,65")
    assert plain(app)[1] == ["particle density 2.65 kg/m³ lies outside [100, 25000]; enter it in kg/m³"]
    shown = [element.value for element in app.main if element.type in ("error", "subheader")]
    assert shown.index(app.error[0].value) < shown.index("Density tests")


def test_errors_speak_of_the_form_s_labels_and_not_of_a_table_s_columns(lab: Store) -> None:
    app = type_in(form(), name="G", sieves="16 0\n8 100", value="1500")
    assert plain(app)[1] == [
        "bulk density 1500 kg/m³ needs a particle density to become a packing density; enter particle density and its "
        "basis",
    ]


def test_an_aggregate_without_a_name_is_refused(lab: Store) -> None:
    app = save(type_in(form(), sieves="16 0\n8 100"))
    assert any("has no name" in error.value for error in app.error)


def test_a_name_with_other_values_is_refused_with_the_remedy(lab: Store) -> None:
    save(type_in(form(), name="G", sieves="16 0\n8 100", particle_density_kg_m3="2600"))
    app = save(type_in(form(), name="G", sieves="16 0\n8 100", particle_density_kg_m3="2700"))
    assert any("give a new delivery its own name" in text for text in plain(app)[1])


def test_a_store_that_cannot_be_opened_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("no store at all" * 100)
    monkeypatch.setenv("PDLAB_STORE", f"sqlite:///{file}")
    st.cache_resource.clear()
    app = page()
    assert "is no pdlab store" in plain(app)[1][0]


def test_an_empty_sieve_table_is_named_when_saved(lab: Store) -> None:
    app = save(type_in(form(), name="G"))
    assert any("the sieve table is empty" in text for text in plain(app)[1])


def test_a_density_test_without_a_value_is_named_and_not_lost(lab: Store) -> None:
    app = save(type_in(form(), name="G", sieves="16 0\n8 100", repeats="3"))
    assert any("the density test has no value" in text for text in plain(app)[1])
    assert stored(lab) == []


def test_a_test_is_added_to_an_imported_aggregate_and_names_lose_their_blanks(lab: Store) -> None:
    experiments.register(lab, read_path(SHIPPED))
    app = form()
    app.selectbox(key="test_0_kind").set_value("voids_percent")
    save(type_in(app, name=" pebbles L ", sieves="60,96 0\n40,64 100", value="39,5"))
    with lab.read() as session:
        row = store_module.aggregates(session, ["pebbles L"])[0]
    assert [test.voids_percent for test in row.packing_tests] == [40.0, 39.5]
    save(
        type_in(
            form(),
            name="pebbles L",
            sieves="60,96 0\n40,64 100",
            value="1500",
            particle_density_kg_m3="2600",
        )
    )
    with lab.read() as session:
        row = store_module.aggregates(session, ["pebbles L"])[0]
    assert (row.particle_density_kg_m3, row.packing_tests[-1].bulk_density_kg_m3) == (2600.0, 1500.0)


def test_the_first_delivery_s_test_does_not_go_to_a_later_one(lab: Store) -> None:
    save(type_in(form(), name="G", sieves="16 0\n8 100"))
    save(type_in(form(), name="G", delivery="May", sieves="16 0\n8 100"))
    save(type_in(form(), name="G", sieves="16 0\n4 100"))
    with lab.read() as session:
        found = {name: store_module.find_aggregate(session, "G", name) for name in ("", "May")}
        counts = {name: len(row.sieve_analyses) for name, row in found.items() if row is not None}
    assert counts == {"": 2, "May": 1}


def test_a_density_out_of_reach_is_explained_beside_its_aggregate(lab: Store, tmp_path: Path) -> None:
    experiments.register(lab, read_path(SHIPPED))
    (tmp_path / "packing_tests.csv").write_text("material,compaction,packing_density\npebbles L,loose,0.47\n")
    experiments.register(lab, read_path(tmp_path / "packing_tests.csv"))
    experiments.predict(lab, FormulaRunner(lab))
    warned = [warning.value.replace("\\", "") for address in ("", "aggregates") for warning in page(address).warning]
    assert any(text.startswith("pebbles L: packing density 0.47 is out of reach of 'monosized'") for text in warned)
    assert any(text.startswith("pebbles L+F 1:1: aggregate 'pebbles L' of mixture") for text in warned)


def sand(lab: Store, folder: Path, count: int) -> None:
    names = [f"Sand {k}" for k in range(count)]
    (folder / "aggregates.csv").write_text("name\n" + "\n".join(names) + "\n")
    lines = [f"{name},{line}" for name in names for line in ("4.75,0", "2.36,60", "1.18,38", "pan,2")]
    (folder / "sieves.csv").write_text("aggregate,aperture_mm,retained_percent\n" + "\n".join(lines) + "\n")
    experiments.register(lab, read_path(folder))


def frame_of(app: AppTest, column: str) -> pd.DataFrame:
    return next(block.value for block in (*app.dataframe, *app.table) if column in block.value.columns)


def test_an_index_has_three_digits_zeros_at_its_end_too() -> None:
    assert [digits(value) for value in (1.2, 6.0, 14.37, 126.4, 0.2136)] == ["1.20", "6.00", "14.4", "126", "0.214"]


def test_aggregates_are_found_by_a_part_of_their_name(lab: Store, tmp_path: Path) -> None:
    sand(lab, tmp_path, 12)
    app = page("aggregates")
    assert len(frame_of(app, "aggregate")) == 12
    app.text_input(key="search").set_value("sand 1").run()
    assert sorted(frame_of(app, "aggregate")["aggregate"]) == ["Sand 1", "Sand 10", "Sand 11"]
    app.text_input(key="search").set_value("gravel").run()
    assert any("No aggregate's name holds 'gravel'" in info.value.replace("\\", "") for info in app.info)


def test_gradings_are_overlaid_and_compared_with_targets(lab: Store, tmp_path: Path) -> None:
    sand(lab, tmp_path, 2)
    app = page("aggregates")
    assert list(frame_of(app, "Sand 1").loc["D50 [mm]"]) == ["2.65", "2.65"]  # 2.36 (4.75/2.36)^(1/6)
    retained = next(table.value for table in app.table if "pan" in table.value.index)
    assert list(retained["Sand 0"]) == ["0.0", "60.0", "38.0", "2.0"]
    app.multiselect(key="targets").set_value(["Fuller", "ASTM C33 fine"]).run()
    app.text_input(key="largest").set_value("0,5").run()
    assert any("largest size 0.5 mm must be above the finest one" in text for text in plain(app)[1])
    app.text_input(key="largest").set_value("4,75").run()
    assert not app.exception
    assert not app.error


def test_of_many_aggregates_the_newest_are_listed_and_the_others_found(
    lab: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sand(lab, tmp_path, 12)
    monkeypatch.setattr(aggregates, "LISTED", 5)
    app = page("aggregates")
    assert list(frame_of(app, "aggregate")["aggregate"]) == [f"Sand {k}" for k in (11, 10, 9, 8, 7)]
    app.text_input(key="search").set_value("Sand 2").run()
    assert list(frame_of(app, "aggregate")["aggregate"]) == ["Sand 2"]


def test_a_database_that_does_not_answer_is_a_sentence(lab: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def away(*_: object, **__: object) -> None:
        raise StoreAway("the database does not answer; try again")

    monkeypatch.setattr(experiments, "listed", away)
    assert plain(page("aggregates"))[1] == ["the database does not answer; try again"]


def test_what_is_looked_at_stays_when_the_search_changes(lab: Store, tmp_path: Path) -> None:
    sand(lab, tmp_path, 12)
    app = page("aggregates")
    app.text_input(key="search").set_value("Sand 2").run()
    assert app.multiselect(key="shown").options == ["Sand 11", "Sand 10", "Sand 9", "Sand 2"]
    before = app.multiselect(key="shown").value
    app.multiselect(key="shown").set_value([*before, "Sand 2"]).run()
    app.text_input(key="search").set_value("").run()
    assert list(frame_of(app, "Sand 2").columns) == ["Sand 11", "Sand 10", "Sand 9", "Sand 2"]
