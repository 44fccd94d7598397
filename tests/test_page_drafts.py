"""What is entered survives a reload as a draft; the grid is filled by sets, texts and files."""

from pathlib import Path
from typing import Any

import pytest
from openpyxl import Workbook
from streamlit.runtime.scriptrunner import RerunData, RerunException, get_script_run_ctx
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, form, lab, plain, save, stored, type_in

from pdlab import experiments
from pdlab import store as store_module
from pdlab.errors import TableError, UnknownName
from pdlab.grading import SIEVE_SETS
from pdlab.page import sieve_table
from pdlab.store import Store
from pdlab.tables import read_path, read_sieve_file

__all__ = ["lab"]


def rows(app: object) -> list[tuple[str, str]]:
    return list(app.session_state[sieve_table.NOW])  # type: ignore[attr-defined]


def test_a_draft_survives_a_reload_with_all_its_texts(lab: Store) -> None:
    app = type_in(form(), name="Kies", sieves="31,5 0\nNo. 120,5", value="15oo", container_height_mm="200")
    app.button(key="add_test").click().run()
    app.text_input(key="test_1_value").set_value("39,5").run()
    number = app.query_params["draft"]
    again = form(number)
    assert rows(again) == [("31,5", "0"), ("No.", "120,5")]
    assert [again.text_input(key=key).value for key in ("name", "test_0_value", "test_1_value")] == [
        "Kies",
        "15oo",
        "39,5",
    ]
    assert [draft.id for draft in experiments.list_drafts(lab, "aggregate")] == [int(number)]


def test_edits_after_a_reload_go_into_the_same_draft(lab: Store) -> None:
    number = type_in(form(), name="Kies").query_params["draft"]
    again = type_in(form(number), sieves="16 0\n8 100", source="Rhine")
    texts = experiments.entered_of(experiments.load_draft(lab, int(number)).content)
    assert (texts.texts["name"], texts.texts["source"], texts.sieves) == ("Kies", "Rhine", (("16", "0"), ("8", "100")))
    assert again.query_params["draft"] == number


def test_two_windows_with_one_draft_lose_nothing_of_each_other(lab: Store) -> None:
    number = type_in(form(), name="Kies").query_params["draft"]
    one, other = form(number), form(number)
    type_in(one, source="Rhine")
    type_in(other, shape="round")
    assert "was changed or saved in another window" in other.warning[0].value
    type_in(one, source="Rhein")
    type_in(other, shape="rounded")
    assert not other.warning
    kept = [experiments.entered_of(draft.content).texts for draft in experiments.list_drafts(lab, "aggregate")]
    assert {(texts["name"], texts["source"], texts["shape"]) for texts in kept} == {
        ("Kies", "Rhein", ""), ("Kies", "", "rounded"),
    }  # fmt: skip


def test_a_draft_is_whole_after_another_view(lab: Store) -> None:
    app = type_in(form(), name="Kies", sieves="16 0\n8 100")
    number, before = app.query_params["draft"], experiments.list_drafts(lab, "aggregate")
    app._page_hash = calc_hash("aggregates")
    app.run()
    app._page_hash = calc_hash("new-aggregate")
    app.query_params["draft"] = number
    app.run()
    assert (app.text_input(key="name").value, rows(app)) == ("Kies", [("16", "0"), ("8", "100")])
    assert [draft.content for draft in experiments.list_drafts(lab, "aggregate")] == [before[0].content]


def test_an_empty_form_is_no_draft_and_a_saved_one_is_none_any_more(lab: Store) -> None:
    app = form()
    app.selectbox(key="sieve_set").set_value("EN 933-2 basic").run()
    assert experiments.list_drafts(lab, "aggregate") == []
    app = type_in(form(), name="Kies", sieves="16 0\n8 100")
    assert len(experiments.list_drafts(lab, "aggregate")) == 1
    save(app)
    assert (experiments.list_drafts(lab, "aggregate"), stored(lab)) == ([], ["Kies"])


def test_drafts_are_offered_and_discarded(lab: Store) -> None:
    number = type_in(form(), name="Kies").query_params["draft"]
    app = form()
    app.button(key=f"discard_{number}").click().run()
    assert experiments.list_drafts(lab, "aggregate") == []
    with pytest.raises(UnknownName, match="draft 1 is not there"):
        experiments.load_draft(lab, int(number))


@pytest.mark.parametrize("number", ["77", "seven"])
def test_the_address_of_a_draft_that_is_gone_gives_a_new_form(lab: Store, number: str) -> None:
    app = form(number)
    assert any("is not there" in warning.value for warning in app.warning)
    assert app.text_input(key="name").value == ""


def test_a_set_of_sieves_keeps_what_has_a_value(lab: Store) -> None:
    app = type_in(form(), sieves="16 0\n8 70\n5 30")
    app.selectbox(key="sieve_set").set_value("EN 933-2 basic").run()
    filled = [row for row in rows(app) if row[1]]
    assert filled == [("16", "0"), ("8", "70"), ("5", "30")]
    assert [sieve for sieve, _ in rows(app)] == [*SIEVE_SETS["EN 933-2 basic"], "pan", "5"]


def test_a_text_fills_the_grid(lab: Store) -> None:
    app = form()
    app.text_area(key="pasted").set_value("No. 4; 0\n2,36  70 g\nnonsense here now").run()
    app.button(key="take_text").click().run()
    assert rows(app) == [("No. 4", "0"), ("2,36", "70g"), ("nonsense here now", "")]
    assert any("'nonsense here now' is no number" in text for text in plain(app)[0])


def test_a_file_fills_the_grid_and_tells_its_kind(lab: Store) -> None:
    app = form()
    file = app.file_uploader[0]
    file.set_value(("sand.csv", b"aggregate,aperture_mm,passing_percent\nS,4,100\nS,2,0\n", "text/csv")).run()
    assert (rows(app), app.selectbox(key="kind").value) == ([("4", "100"), ("2", "0")], "passing_percent")


def test_a_file_that_is_no_sieve_table_is_a_sentence(lab: Store) -> None:
    app = form()
    app.file_uploader[0].set_value(("sand.csv", b"4\n2\n", "text/csv")).run()
    assert any("a sieve table has two columns" in text for text in plain(app)[1])


def test_a_test_more_of_a_known_aggregate_needs_no_sieves(lab: Store) -> None:
    save(type_in(form(), name="G", sieves="16 0\n8 100"))
    app = form()
    app.selectbox(key="test_0_kind").set_value("voids_percent")
    save(type_in(app, name="G", value="39,5", date="2026-03-31", standard="EN 1097-3"))
    with lab.read() as session:
        row = store_module.aggregates(session, ["G"])[0]
    assert [(test.voids_percent, str(test.date)) for test in row.packing_tests] == [(39.5, "2026-03-31")]


def test_several_tests_each_say_what_they_mean_or_what_is_wrong(lab: Store) -> None:
    app = type_in(form(), name="G", sieves="16 0\n8 100", particle_density_kg_m3="2600", value="1560", date="31.3.26")
    app.button(key="add_test").click().run()
    app.text_input(key="test_1_value").set_value("1300").run()
    assert [metric.value for metric in app.metric] == ["0.5000 ± 0.0050", "50.0"]
    assert any("date: '31.3.26' is no date" in text for text in plain(app)[1])
    assert stored(lab) == []


def test_a_basis_without_its_absorption_is_named_while_typing(lab: Store) -> None:
    app = form()
    app.selectbox(key="density_basis").set_value("ssd")
    type_in(app, name="G", sieves="16 0\n8 100", particle_density_kg_m3="2600")
    assert any("needs the water absorption" in text for text in plain(app)[1])


CSV = {
    "decimal commas": ("a.csv", b"Sieb;Masse\n31,5;0\n16;120,5\n"),
    "no header": ("a.csv", b"31,5;0\n16;120,5\n"),
    "tabs": ("a.txt", b"31,5\t0\n16\t120,5\n"),
    "the table format": ("a.csv", b"aggregate;aperture_mm;retained_g\nA;31,5;0\nA;16;120,5\n"),
}


@pytest.mark.parametrize(("name", "content"), CSV.values(), ids=CSV)
def test_a_file_s_cells_are_read_as_they_stand(name: str, content: bytes) -> None:
    assert read_sieve_file(name, content).cells == (("31,5", "0"), ("16", "120,5"))


def test_a_workbook_s_cells_are_read_with_all_their_digits(tmp_path: Path) -> None:
    book = Workbook()
    for line in (["sieve", "passing"], ["No. 4", 100], [2.36, 12.25]):
        book.active.append(line)
    book.save(tmp_path / "a.xlsx")
    assert read_sieve_file("a.xlsx", (tmp_path / "a.xlsx").read_bytes()).cells == (("No. 4", "100"), ("2.36", "12.25"))


WRONG = {
    "two aggregates": ("a.csv", b"aggregate,aperture_mm,retained_g\nA,4,1\nB,2,1\n", "it holds 2 aggregates"),
    "nothing": ("a.csv", b"\n", "it is empty"),
    "another workbook": ("a.xls", b"x", "'.xls' cannot be read"),
    "no workbook": ("a.xlsx", b"x", "no Excel workbook"),
    "one column": ("a.csv", b"4\n", "has two columns"),
}


@pytest.mark.parametrize(("name", "content", "message"), WRONG.values(), ids=WRONG)
def test_what_is_no_sieve_file_is_named(name: str, content: bytes, message: str) -> None:
    with pytest.raises(TableError, match=message):
        read_sieve_file(name, content)


def test_drafts_are_kept_on_both_databases(store: Store) -> None:
    first = experiments.save_draft(store, "aggregate", {"texts": {"name": "Körnung"}})
    second = experiments.save_draft(store, "mixture", {"texts": {}})
    assert experiments.save_draft(store, "aggregate", {"texts": {"name": "Kies"}}, first) == first
    assert experiments.load_draft(store, first).content == {"texts": {"name": "Kies"}}
    assert [draft.id for draft in experiments.list_drafts(store, "mixture")] == [second]
    other = experiments.save_draft(
        store, "aggregate", {"texts": {"name": "Sand"}}, first, {"texts": {"name": "Körnung"}}
    )
    assert other != first, "another has written it since"
    experiments.delete_draft(store, first, {"texts": {"name": "Körnung"}})
    assert experiments.load_draft(store, first).content == {"texts": {"name": "Kies"}}
    experiments.delete_draft(store, other, {"texts": {"name": "Sand"}})
    experiments.delete_draft(store, first)
    experiments.delete_draft(store, first)
    assert experiments.list_drafts(store, "aggregate") == []


def again(lab: Store, aggregate: str) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("new-aggregate")
    app.query_params["aggregate"] = aggregate
    app.run()
    assert not app.exception
    return app


def test_a_further_test_of_an_aggregate_is_entered_with_the_aggregate_filled_in(lab: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text(
        "name,delivery,particle_density_kg_m3,density_basis,water_absorption_percent,source\n"
        "Kies,spring,2650.5,ssd,1.25,Rhine\n"
    )
    (tmp_path / "sieves.csv").write_text("aggregate,delivery,aperture_mm,passing_percent\nKies,spring,16,100\n"
                                         "Kies,spring,8,0\n")  # fmt: skip
    experiments.register(lab, read_path(tmp_path))
    app = again(lab, "1")
    keys = ("name", "delivery", "particle_density_kg_m3", "water_absorption_percent", "source")
    assert [app.text_input(key=key).value for key in keys] == ["Kies", "spring", "2650.5", "1.25", "Rhine"]
    assert (app.selectbox(key="density_basis").value, rows(app)) == ("ssd", [])
    assert (experiments.list_drafts(lab, "aggregate"), dict(app.query_params)) == ([], {"aggregate": "1"})
    type_in(app, value="1560,5")
    assert [draft.id for draft in experiments.list_drafts(lab, "aggregate")] == [int(app.query_params["draft"])]
    assert "aggregate" not in app.query_params
    save(app)
    with lab.read() as session:
        (row,) = store_module.aggregates(session)
        assert ([test.bulk_density_kg_m3 for test in row.packing_tests], len(row.sieve_analyses)) == ([1560.5], 1)
        assert (row.particle_density_kg_m3, row.density_basis, row.version) == (2650.5, "ssd", 1)


def test_a_test_that_is_there_already_is_not_said_to_be_saved(lab: Store) -> None:
    told = {"value": "1500", "particle_density_kg_m3": "2600"}
    save(type_in(form(), name="Kies", sieves="16 0\n8 100", **told))
    app = save(type_in(again(lab, "1"), value="1500"))
    assert [text.value for text in app.warning] == [
        "Not saved again: all of this is there already. If a test was made anew, give it its date."
    ]
    app = save(type_in(app, date="2026-03-31"))
    assert [text.value.replace("\\", "").partition("; next")[0] for text in app.success] == ["saved: Kies"]
    app = save(type_in(again(lab, "1"), sieves="16 0\n8 100", value="1510"))
    (said,) = (text.value.replace("\\", "").partition("; next")[0] for text in app.success)
    assert said == "saved: Kies, but for 1 test that equals one that is there"


def test_another_address_of_the_same_view_puts_another_form_there(lab: Store, tmp_path: Path) -> None:
    (tmp_path / "aggregates.csv").write_text("name\nKies\nSand\n")
    experiments.register(lab, read_path(tmp_path / "aggregates.csv"))
    app = again(lab, "2")
    assert app.text_input(key="name").value == "Sand"
    for address, name in (("1", "Kies"), ("", "")):
        app.query_params.pop("aggregate")
        if address:
            app.query_params["aggregate"] = address
        assert app.run().text_input(key="name").value == name


@pytest.mark.parametrize("address", ["9", "-1", "one", "9" * 5000])
def test_a_further_test_of_an_aggregate_that_is_not_there_is_a_sentence(lab: Store, address: str) -> None:
    app = again(lab, address)
    said = [warning.value.replace("\\", "") for warning in app.warning]
    assert said == [f"no aggregate {address} is there. This is a new one."]
    assert app.text_input(key="name").value == ""


def test_what_is_typed_before_the_browser_hears_of_the_draft_goes_into_it(lab: Store) -> None:
    app = type_in(form(), name="Kies")
    number = app.query_params.pop("draft")  # the next texts were sent with the address as it was
    type_in(app, shape="round")
    app.query_params.pop("draft")  # and so were these
    type_in(app, source="Rhine")
    assert (app.text_input(key="name").value, app.query_params["draft"]) == ("Kies", number)
    (draft,) = experiments.list_drafts(lab, "aggregate")
    assert [draft.content["texts"][name] for name in ("name", "shape", "source")] == ["Kies", "round", "Rhine"]
    app.run()
    app.query_params.pop("draft")  # now the browser knows it, so that this is a new form
    assert app.run().text_input(key="name").value == ""


def test_a_run_that_ends_while_its_draft_is_written_leaves_that_draft_alone(
    lab: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, write = form(), experiments.save_draft

    def interrupted(*args: Any) -> int:
        """Write a draft while the browser asks for another run, which begins at the next use of the session."""
        number, context = write(*args), get_script_run_ctx()
        assert context is not None
        usual = context.session_state._yield_callback

        def ask() -> None:
            object.__setattr__(context.session_state, "_yield_callback", usual)
            raise RerunException(RerunData(page_script_hash=calc_hash("new-aggregate")))

        object.__setattr__(context.session_state, "_yield_callback", ask)
        monkeypatch.setattr(experiments, "save_draft", write)
        return number

    monkeypatch.setattr(experiments, "save_draft", interrupted)
    type_in(app, name="Kies")
    assert experiments.save_draft is write  # it was interrupted
    type_in(app, source="Rhine")
    (draft,) = experiments.list_drafts(lab, "aggregate")
    assert [draft.content["texts"][name] for name in ("name", "source")] == ["Kies", "Rhine"]
    assert app.query_params["draft"] == str(draft.id)
