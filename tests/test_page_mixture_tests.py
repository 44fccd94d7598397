"""A mixture's density test entered on its view: checked while typed, kept, saved, beside the prediction."""

from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest
from conftest import FormulaRunner
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_mixing import dense, ids
from test_page import PAGE, lab, plain
from test_page_mixtures import EQUAL, metrics, mixture, ran, said, stocked, view

from pdlab import experiments
from pdlab.errors import InputError, TableError
from pdlab.experiments import TEST_TEXTS
from pdlab.page import mixture_tests
from pdlab.store import Store

__all__ = ["lab", "stocked"]


@pytest.fixture
def unmeasured(stocked: Store) -> int:
    parts = ids(stocked, "pebbles L", "pebbles F")
    return experiments.register_mixture(stocked, "new", parts, [0.3, 0.7], by_mass=False)


def typed(app: AppTest, asked: int, kind: str = "voids_percent", compaction: str = "loose", **texts: str) -> AppTest:
    place = f"test_of_mixture_{asked}_"
    if not opened(app):
        app.session_state[box(app).proto.id.rpartition("-")[2]] = True
        ran(app)
    app.selectbox(key=f"{place}kind").set_value(kind)
    app.selectbox(key=f"{place}compaction").set_value(compaction)
    for name, text in texts.items():
        app.text_input(key=place + name).set_value(text)
    return ran(app)


def value(app: AppTest, asked: int) -> str:
    return str(app.text_input(key=f"test_of_mixture_{asked}_value").value)


def saved(app: AppTest) -> AppTest:
    return ran(app.button(key="save_test").click())


def box(app: AppTest) -> Any:
    (found,) = [one for one in app.expander if one.label == mixture_tests.ENTER]
    return found


def opened(app: AppTest) -> bool:
    return bool(box(app).children)


def told(app: AppTest) -> str:
    text = app.query_params.get(mixture_tests.WORD, "")
    return text if isinstance(text, str) else text[0]


def test_what_a_density_test_means_is_said_while_it_is_typed(stocked: Store, unmeasured: int) -> None:
    app = view(unmeasured)
    assert opened(app)
    assert metrics(app) == {}
    typed(app, unmeasured, value="36,5", repeats="3", standard_deviation="0,6")
    assert metrics(app) == {"Packing density": "0.6350 ± 0.0035", "Voids [%]": "36.5"}
    assert experiments.mixture_tests(stocked, unmeasured) == ()


def test_a_saved_test_stands_beside_the_prediction_at_once(stocked: Store, unmeasured: int) -> None:
    (report,) = experiments.predict(stocked, FormulaRunner(stocked), ["new"])
    app = view(unmeasured)
    typed(app, unmeasured, compaction="rodded", value="36,5", date="2026-03-31", standard="EN 1097-3")
    saved(app)
    (test,) = experiments.mixture_tests(stocked, unmeasured)
    assert (test.kind, test.value, test.compaction, str(test.date)) == ("voids_percent", 36.5, "rodded", "2026-03-31")
    assert "voids_percent=36,5" in test.raw_text, "the text as it was typed is kept"
    (table,) = [block.value for block in app.table if "minus measured" in block.value]
    assert table.loc["measured PD", "packing density"] == "0.6350"
    assert table.loc["predicted PD", "minus measured"] == f"{(report.packing_density or 0.0) - 0.635:+.4f}"
    assert "The mixture's density test is rodded, its beds are loose: the difference is of both" in said(app)
    assert [one.value.replace("\\", "") for one in app.success] == [
        "saved: a density test of new; it stands beside the prediction"
    ]
    assert (told(app), opened(app)) == ("", False)


def test_the_tests_that_were_entered_are_listed_and_the_newest_counts(stocked: Store, unmeasured: int) -> None:
    app = view(unmeasured)
    for date, text in (("2026-03-30", "36,5"), ("2026-03-31", "36.8")):
        saved(typed(app, unmeasured, value=text, date=date))
    (table,) = [block.value for block in app.table if "entered" in block.value]
    assert list(table["date"]) == ["2026-03-31", "2026-03-30"]
    assert [text.replace("\\", "") for text in table["entered"]] == ["voids [%]: 36.8", "voids [%]: 36.5"]
    assert list(table["measured PD"]) == ["0.6320 ± 0.0050", "0.6350 ± 0.0050"]
    assert "The first counts." in said(app)


@pytest.mark.parametrize(
    ("kind", "texts", "sentence"),
    [
        ("voids_percent", {"value": "much"}, "voids: 'much' is no number; write it like 12.5 % or 12,5 %"),
        ("voids_percent", {"value": "136"}, "voids 136 gives a packing density of -0.36, outside (0, 1)"),
        ("voids_percent", {"repeats": "3"}, "the density test has no value; enter it, or empty its other fields"),
        ("voids_percent", {"value": "36", "date": "31.3.26"}, "date: '31.3.26' is no date"),
        ("voids_percent", {"value": "36", "moisture_percent": "100"}, "moisture: 100"),
        ("packing_density", {"value": "0.64", "standard_deviation": "0,6"}, "standard deviation 0.6 is 0.6 in PD"),
        ("bulk_density_kg_m3", {"value": "1600"}, "bulk density 1600 kg/m³ needs a particle density"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_saved(
    stocked: Store, unmeasured: int, kind: str, texts: dict[str, str], sentence: str
) -> None:
    app = typed(view(unmeasured), unmeasured, kind, **texts)
    assert [text.startswith(sentence) for text in plain(app)[1]] == [True]
    assert metrics(app) == {}
    saved(app)
    assert plain(app)[1][1:] == ["not saved: mend what is marked above first"]
    assert experiments.mixture_tests(stocked, unmeasured) == ()


def test_an_empty_test_is_not_saved(stocked: Store, unmeasured: int) -> None:
    assert plain(saved(view(unmeasured)))[1] == ["the density test has no value; enter one"]


def test_a_bulk_density_takes_the_mean_particle_density(stocked: Store, unmeasured: int, tmp_path: Path) -> None:
    app = typed(view(unmeasured), unmeasured, "bulk_density_kg_m3", value="1600")
    assert any("The particle density of pebbles L, pebbles F is missing" in text for text in said(app))
    dense(stocked, tmp_path)
    particle = experiments.composition(stocked, unmeasured).particle_density
    assert particle is not None
    assert metrics(ran(app))["Packing density"] == f"{1600.0 / particle:.4f} ± 0.0050"
    assert not any("is missing" in text for text in said(app))
    saved(app)
    (test,) = experiments.mixture_tests(stocked, unmeasured)
    assert test.packing_density == pytest.approx(1600.0 / particle)


def test_an_equal_test_is_not_saved_twice(stocked: Store, unmeasured: int) -> None:
    app = view(unmeasured)
    saved(typed(app, unmeasured, value="36,5"))
    saved(typed(app, unmeasured, value="36.5"))
    assert any("an equal test is there. If it was measured anew, give it its date" in text for text in said(app))
    assert value(app, unmeasured) == "36.5", "what was typed stays"
    assert len(experiments.mixture_tests(stocked, unmeasured)) == 1


def test_what_is_typed_survives_a_reload_another_view_and_another_mixture(stocked: Store, unmeasured: int) -> None:
    app = typed(view(unmeasured), unmeasured, value="36,5", repeats="3")
    address = told(app)
    other = mixture(stocked)
    ran(app.selectbox(key="mixture").set_value(other))
    assert (opened(app), told(app)) == (False, ""), "a test of one mixture is none of another"
    ran(app.selectbox(key="mixture").set_value(unmeasured))
    assert (value(app, unmeasured), told(app)) == ("36,5", address)
    app._page_hash = calc_hash("aggregates")
    ran(app)
    app._page_hash = calc_hash("mixtures")
    assert value(ran(app), unmeasured) == "36,5"
    for asked in (other, unmeasured):
        again = AppTest.from_file(str(PAGE), default_timeout=60)
        again._page_hash = calc_hash("mixtures")
        again.query_params["mixture"], again.query_params["test"] = str(asked), address
        assert opened(ran(again)) == (asked == unmeasured)
    assert value(ran(again), unmeasured) == "36,5"


def test_an_address_with_choices_that_are_none_takes_the_first(stocked: Store, unmeasured: int) -> None:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("mixtures")
    app.query_params["mixture"] = str(unmeasured)
    app.query_params["test"] = urlencode({"of": unmeasured, "kind": "porosity", "value": "36"})
    assert value(ran(app), unmeasured) == "36"
    assert app.selectbox(key=f"test_of_mixture_{unmeasured}_kind").value == "bulk_density_kg_m3"


def test_a_form_of_a_measured_mixture_is_closed_until_it_is_wanted(stocked: Store) -> None:
    asked = mixture(stocked)
    app = view(asked)
    assert not opened(app)
    typed(app, asked, value="3")
    typed(app, asked, value="")
    assert opened(app), "it does not close under the fingers"
    again = AppTest.from_file(str(PAGE), default_timeout=60)
    again._page_hash = calc_hash("mixtures")
    again.query_params["mixture"] = str(asked)
    again.query_params["test"] = told(typed(app, asked, value="36,5", date="2026-03-31"))
    assert opened(ran(again)), "what is typed already is shown"
    assert not opened(saved(app)), "a further test is another one"


def test_a_test_is_registered_as_an_import_would(pebbles: Store) -> None:
    (asked,) = [key for key, name in experiments.mixture_names(pebbles, 9).items() if name == EQUAL]
    before = len(experiments.mixture_tests(pebbles, asked))
    texts = dict.fromkeys(TEST_TEXTS, "") | {"kind": "voids_percent", "value": "35", "compaction": "loose"}
    assert experiments.register_test(pebbles, EQUAL, texts)
    assert not experiments.register_test(pebbles, EQUAL, texts)
    assert len(experiments.mixture_tests(pebbles, asked)) == before + 1
    with pytest.raises(InputError, match="has no value; enter one"):
        experiments.register_test(pebbles, EQUAL, texts | {"value": " "})
    with pytest.raises(TableError, match="no mixture named 'gone'"):
        experiments.register_test(pebbles, "gone", texts)
    with pytest.raises(TableError, match="'3o' is no number"):
        experiments.register_test(pebbles, EQUAL, texts | {"value": "3o"})
