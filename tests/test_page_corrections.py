"""The view of corrections by AppTest: each kind of record, who and why, edits that would be lost, what is outdated."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import streamlit as st
from conftest import FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_mixing import ids
from test_page import PAGE, lab, plain
from test_page_mixtures import EQUAL, charted, metrics, mixture, ran, said, stocked

from pdlab import experiments
from pdlab.experiments import Recorded
from pdlab.page import signing_in
from pdlab.page.wording import AFRESH
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab", "stocked"]


def view(kind: str = "", key: int | str = "") -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("corrections")
    if kind:
        app.query_params[kind] = str(key)
    return ran(app)


def of(target: Store, name: str, kind: str) -> tuple[AppTest, int, Recorded]:
    """Open a record of an aggregate or a mixture."""
    material = "mixture" if name == EQUAL else "aggregate"
    key = mixture(target) if name == EQUAL else ids(target, name)[0]
    record = next(one for one in experiments.recorded(target, material, key).records if one.kind == kind)
    app = view(material, key)
    return ran(app.selectbox[0].set_value(record.key)), key, record


def typed(app: AppTest, record: Recorded, **texts: str) -> AppTest:
    """Type over a record's own texts."""
    place = f"{record.key}_{record.version}"
    for name, text in texts.items():
        key = f"test_{place}_{name}" if record.kind == "packing_test" else f"{name}_of_{place}"
        app.text_input(key=key).set_value(text)
    return ran(app)


def cells(app: AppTest, record: Recorded, **rows: dict[str, str]) -> AppTest:
    """Type over cells of a record's grid, by ``row_0`` and so on."""
    edits = {int(row.removeprefix("row_")): columns for row, columns in rows.items()}
    app.session_state[f"parts_of_{record.key}_{record.version}"] = {
        "edited_rows": edits, "added_rows": [], "deleted_rows": [],
    }  # fmt: skip
    return ran(app)


def saved(app: AppTest, who: str = "Anna", why: str = "misread") -> AppTest:
    if who:
        app.text_input(key="who").set_value(who)
    next(box for box in app.text_input if box.label == "Why").set_value(why)
    return ran(app.button(key="save_correction").click())


def table(app: AppTest, *columns: str) -> list[list[str]]:
    """Return the rows of the table that has just these columns."""
    found = [block.value for block in app.table if list(block.value.columns) == list(columns)]
    return [[str(text).replace("\\", "") for text in row] for frame in found for row in frame.itertuples(index=False)]


def history(app: AppTest) -> list[list[str]]:
    return [row[1:] for row in table(app, "when (UTC)", "record", "what", "before", "after", "who", "why")]


def successes(app: AppTest) -> list[str]:
    return [block.value.replace("\\", "") for block in app.success]


def test_without_a_material_it_leads_to_where_one_comes_from(stocked: Store) -> None:
    assert any("its view leads to what was entered of it" in text for text in said(view()))
    assert any("no aggregate 99" in text for text in plain(view("aggregate", 99))[1])
    assert any("'pebbles' in the address is no mixture" in text for text in said(view("mixture", "pebbles")))


def test_a_density_test_is_corrected_and_says_what_it_means_meanwhile(stocked: Store) -> None:
    app, _, record = of(stocked, "pebbles L", "packing_test")
    assert metrics(app) == {"Packing density": "0.6000 ± 0.0050", "Voids [%]": "40.0"}
    assert "As it was entered: material pebbles L; Compaction unstated; Voids [%] 40.0" in said(app)
    assert "Nothing yet." in said(app)
    typed(app, record, value="40,3")
    assert metrics(app)["Packing density"] == "0.5970 ± 0.0050"
    assert table(app, "what", "before", "after") == [["Voids [%]", "40", "40,3"]]
    saved(app)
    assert successes(app) == ["corrected: Voids [%] 40.0 → 40.3"]
    assert history(app) == [
        [f"density test, unstated, voids [%]: 40.3, entered on {record.created_at:%Y-%m-%d}",
         "Voids [%]", "40.0", "40.3", "Anna", "misread"],
    ]  # fmt: skip
    assert app.text_input(key=f"test_{record.key}_2_value").value == "40.3"
    assert app.selectbox[0].value == record.key
    assert "voids [%]: 40.3" in app.selectbox[0].proto.options[app.selectbox[0].index]
    assert table(app, "what", "before", "after") == []
    assert next(box.value for box in app.text_input if box.label == "Why") == ""
    assert app.text_input(key="who").value == "Anna", "the name is asked once"


def test_a_sieve_table_is_corrected_cell_by_cell(stocked: Store) -> None:
    app, _, record = of(stocked, "pebbles F", "sieve_analysis")
    assert charted(app) == 1
    before = record.parts[1].texts
    cells(app, record, row_1={"aperture_mm": "10"})
    assert table(app, "record", "what", "before", "after") == [
        [record.parts[1].entered, "Sieve [mm]", before["aperture_mm"], "10"]
    ]
    typed(app, record, date="2026-03-31")
    saved(app)
    assert {tuple(row[1:]) for row in history(app)} == {
        ("Date", "–", "2026-03-31", "Anna", "misread"),
        ("Sieve [mm]", before["aperture_mm"], "10.0", "Anna", "misread"),
    }
    again = experiments.recorded(stocked, "aggregate", ids(stocked, "pebbles F")[0]).records[0]
    assert (again.parts[1].texts["aperture_mm"], again.texts["date"], again.version) == ("10", "2026-03-31", 2)


def test_what_is_wrong_in_a_sieve_table_stands_beside_its_row_and_is_not_saved(stocked: Store) -> None:
    app, key, record = of(stocked, "pebbles F", "sieve_analysis")
    cells(app, record, row_1={"aperture_mm": "1o"})
    assert any("'1o' is no number" in text for text in plain(app)[0])
    saved(app)
    assert plain(app)[1][-1] == "not saved: mend what is marked above first"
    assert experiments.recorded(stocked, "aggregate", key).corrections == ()


def test_a_number_that_stands_is_no_guess_beside_a_decimal_comma(stocked: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nfine\n")
    (tmp_path / "sieves.csv").write_text(
        "aggregate,aperture_mm,passing_percent\nfine,2,100\nfine,1.18,55.125\nfine,1,1.125\n"
    )
    experiments.register(stocked, read_path(tmp_path))
    app, key, record = of(stocked, "fine", "sieve_analysis")
    cells(app, record, row_1={"passing_percent": "55,5"})
    assert plain(app) == ([], [])
    saved(app)
    parts = experiments.recorded(stocked, "aggregate", key).records[0].parts
    assert [part.texts["passing_percent"] for part in parts] == ["100", "55.5", "1.125"]


def test_the_aggregate_itself_is_corrected(stocked: Store) -> None:
    app, key, record = of(stocked, "pebbles L", "aggregate")
    place = f"{record.key}_{record.version}"
    typed(app, record, particle_density_kg_m3="2650")
    saved(app)
    assert any("a particle density and its basis go together" in text for text in plain(app)[1])
    app.selectbox(key=f"density_basis_of_{place}").set_value("oven_dry")
    typed(app, record, name="pebbles XL")
    saved(app)
    assert experiments.recorded(stocked, "aggregate", key).particle == 2650.0
    assert next(block.value for block in app.subheader) == "pebbles XL"
    assert {tuple(row[1:4]) for row in history(app)} == {
        ("Name", "pebbles L", "pebbles XL"), ("Particle density [kg/m³]", "–", "2650.0"),
        ("Its basis", "–", "oven_dry"),
    }  # fmt: skip


def test_a_mixture_is_corrected_in_percent(stocked: Store) -> None:
    app, key, record = of(stocked, EQUAL, "mixture")
    cells(app, record, row_0={"share": "60"})
    whole = "the shares sum to 110 %, more than 0.11 off 100; correct them"
    assert plain(app)[1] == [whole], "before it is saved"
    assert plain(saved(app))[1] == [whole, "not saved: mend what is marked above first"]
    cells(app, record, row_0={"share": "60"}, row_1={"share": "much"})
    assert any("pebbles F: 'much' is no number" in text for text in plain(app)[1])
    assert plain(saved(app))[1][-1] == "not saved: mend what is marked above first"
    cells(app, record, row_0={"share": "60"}, row_1={"share": "40 %"})
    saved(app)
    assert experiments.composition(stocked, key).shares == pytest.approx((0.6, 0.4))
    assert history(app)[0][1:4] == ["Share of the solid volume", "0.5", "0.4"]


@pytest.mark.parametrize(
    ("who", "why", "value", "sentence"),
    [
        ("", "misread", "40,3", "say who corrects it: it stays in the history"),
        ("Anna", " ", "40,3", "say why: it stays in the history"),
        ("Anna", "misread", "40", "nothing is changed; type over what is wrong first"),
        ("Anna", "misread", "4o", "not saved: mend what is marked above first"),
    ],
)
def test_what_is_missing_of_a_correction_is_said(stocked: Store, who: str, why: str, value: str, sentence: str) -> None:
    app, key, record = of(stocked, "pebbles L", "packing_test")
    saved(typed(app, record, value=value), who, why)
    assert plain(app)[1][-1] == sentence
    assert experiments.recorded(stocked, "aggregate", key).corrections == ()


def test_the_same_value_written_otherwise_is_no_correction(stocked: Store) -> None:
    app, key, record = of(stocked, "pebbles L", "packing_test")
    saved(typed(app, record, value="40,0 %"))
    assert successes(app) == ["nothing to correct: the same values, written otherwise"]
    assert experiments.recorded(stocked, "aggregate", key).corrections == ()


def test_an_edit_that_another_has_overtaken_is_told_and_begun_anew(stocked: Store) -> None:
    app, key, record = of(stocked, "pebbles L", "packing_test")
    typed(app, record, value="40,3")
    experiments.correct(stocked, {record.address: {"voids_percent": "41"}}, "Ben")
    saved(app)
    (sentence,) = plain(app)[1]
    assert sentence.startswith(f"{record.address} was changed since you saw it, by Ben on ")
    assert sentence.endswith(f"press '{AFRESH}' and correct what is still wrong")
    assert any("Another has corrected this record since you opened it" in text for text in said(app))
    assert app.text_input(key=f"test_{record.key}_1_value").value == "40,3", "what was typed stays until then"
    ran(app.button(key="afresh").click())
    assert app.text_input(key=f"test_{record.key}_2_value").value == "41"
    assert [row[3:5] for row in history(app)] == [["41.0", "Ben"]]
    (found,) = experiments.recorded(stocked, "aggregate", key).corrections
    assert found.by == "Ben"


def test_what_another_corrected_is_shown_where_nothing_was_typed(stocked: Store) -> None:
    app, _, record = of(stocked, "pebbles L", "packing_test")
    experiments.correct(stocked, {record.address: {"voids_percent": "41"}}, "Ben")
    ran(app)
    assert app.text_input(key=f"test_{record.key}_2_value").value == "41"
    assert not app.warning


def test_a_name_that_another_changed_is_an_edit_overtaken(stocked: Store) -> None:
    app, _, record = of(stocked, "pebbles L", "aggregate")
    typed(app, record, source="a quarry")
    experiments.correct(stocked, {record.address: {"name": "pebbles XL"}}, "Ben")
    saved(app)
    assert [
        text.startswith("aggregate:pebbles XL was changed since you saw it, by Ben on ") for text in plain(app)[1]
    ] == [True]


def test_who_is_signed_in_is_who_corrects(stocked: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signing_in, "st", SimpleNamespace(
        user={"is_logged_in": True, "email": "anna@lab.example"}, secrets=st.secrets, container=st.container,
        text=st.text, button=st.button, logout=st.logout, context=SimpleNamespace(cookies={}),
    ))  # fmt: skip
    app, _, record = of(stocked, "pebbles L", "packing_test")
    assert next(box for box in app.text_input if box.label == "Who corrects").disabled
    saved(typed(app, record, value="40,3"), who="")
    assert history(app)[0][4] == "anna@lab.example"


def test_what_is_outdated_is_named_with_what_to_press(stocked: Store) -> None:
    experiments.predict(stocked, FormulaRunner(stocked))
    app, _, record = of(stocked, "pebbles L", "packing_test")
    assert not app.warning
    saved(typed(app, record, value="40,3"))
    (warned,) = [block.value.replace("\\", "") for block in app.warning]
    assert warned == (
        "Outdated now: the calibration, the prediction of pebbles L+M 1:1, the prediction of pebbles L+F 1:1. Press "
        "'Calibrate' and 'Predict' there:"
    )
    ways = [link.proto.label.replace("\\", "") for link in app.get("page_link")]
    assert ways == ["Its calibration", "pebbles L+M 1:1", "pebbles L+F 1:1"]


def test_another_record_begins_with_what_stands(stocked: Store) -> None:
    app, key, record = of(stocked, "pebbles L", "packing_test")
    typed(app, record, value="40,3")
    sieved = experiments.recorded(stocked, "aggregate", key).records[0].key
    ran(app.selectbox[0].set_value(sieved))
    assert table(app, "record", "what", "before", "after") == []
    ran(app.selectbox[0].set_value(record.key))
    assert app.text_input(key=f"test_{record.key}_1_value").value == "40"


@pytest.mark.parametrize(("address", "label"), [("aggregates", "Correct pebbles L"),
                                                ("mixtures", "Correct what was entered of this mixture")])  # fmt: skip
def test_the_views_of_the_materials_lead_here(stocked: Store, address: str, label: str) -> None:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash(address)
    app.query_params["mixture"] = str(mixture(stocked))
    ran(app)
    assert label in [link.proto.label.replace("\\", "") for link in app.get("page_link")]
