"""Every failure is a sentence: a store that is gone, locked, not to be written to or of an older revision."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import streamlit as st
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, lab, type_in
from test_page_mixture_tests import typed as typed_test
from test_page_mixtures import stocked

from pdlab import experiments
from pdlab.errors import StoreAway
from pdlab.page.app import CORRECTIONS, VIEWS
from pdlab.store import Store, databases, open_store

__all__ = ["lab", "stocked"]
REFUSED = "the store lab.db cannot be used (attempt to write a readonly database); allow reading and writing it"


def view(address: str, **query: str) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash(address)
    for name, text in query.items():
        app.query_params[name] = text
    app.run()
    assert not app.exception
    return app


def errors(app: AppTest) -> list[str]:
    assert not app.exception
    return [error.value.replace("\\", "") for error in app.error]


@contextmanager
def refusing(self: Store) -> Iterator[Any]:
    raise StoreAway(REFUSED)
    yield


def typed(app: AppTest) -> AppTest:
    return type_in(app, name="Kies")


def packed(app: AppTest) -> AppTest:
    typed_test(app, 1, value="36,5")
    return app.button(key="save_test").click().run()


def corrected(app: AppTest) -> AppTest:
    app.selectbox[0].set_value("packing_test:1").run()
    app.text_input(key="test_packing_test:1_1_value").set_value("40,3")
    app.text_input(key="who").set_value("Anna")
    app.text_input(key="why_packing_test:1_1").set_value("misread").run()
    return app.button(key="save_correction").click().run()


ACTIONS: dict[str, tuple[str, dict[str, str], Callable[[AppTest], AppTest]]] = {
    "keep a draft": ("new-aggregate", {}, typed),
    "discard a draft": ("new-aggregate", {}, lambda app: app.button(key="discard_1").click().run()),
    "save an aggregate": ("new-aggregate", {"draft": "1"}, lambda app: app.button(key="save").click().run()),
    "calibrate": ("calibration", {"aggregate": "1"}, lambda app: app.button(key="calibrate").click().run()),
    "predict": ("mixtures", {"mixture": "1"}, lambda app: app.button(key="predict").click().run()),
    "save a density test": ("mixtures", {"mixture": "1"}, packed),
    "correct": (CORRECTIONS, {"aggregate": "1"}, corrected),
    "cancel": ("mixtures", {"mixture": "2"}, lambda app: app.button(key="cancel").click().run()),
    "save a mixture": (
        "mixtures", {"parts": "1,2", "name": "new"}, lambda app: app.button(key="save").click().run()
    ),
}  # fmt: skip


@pytest.mark.parametrize("action", ACTIONS)
def test_what_cannot_be_written_is_a_sentence(stocked: Store, action: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = {"texts": {"name": "Kies"}, "sieves": [["16", "0"], ["8", "100"]]}
    experiments.save_draft(stocked, "aggregate", content)
    experiments.ask_prediction(stocked, 2, "monosized")
    address, query, act = ACTIONS[action]
    app = view(address, **query)
    monkeypatch.setattr(Store, "write", refusing)
    assert REFUSED in errors(act(app))


def test_what_cannot_be_read_is_a_sentence_on_every_view(stocked: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    views = [view(address, aggregate="1") if address == CORRECTIONS else view(address) for address in VIEWS]
    monkeypatch.setattr(Store, "read", refusing)
    for app in views:
        assert REFUSED in errors(app.run())


def test_a_look_at_a_wish_that_fails_leaves_the_view_as_it_is(stocked: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise StoreAway(REFUSED)

    experiments.ask_prediction(stocked, 2, "monosized")
    monkeypatch.setattr("pdlab.page.mixtures.partial", lambda *_: fail)
    app = view("mixtures", mixture="2")
    assert errors(app) == [REFUSED]
    assert app.button(key="cancel")
    assert len(app.table) > 0


def test_a_store_file_that_is_gone_is_a_sentence_and_none_is_made_in_its_place(stocked: Store, tmp_path: Path) -> None:
    app = view("mixtures")
    file = tmp_path / "lab.db"
    file.rename(tmp_path / "away.db")
    (sentence,) = errors(app.run())
    assert f"the file of sqlite:///{file} was moved, deleted or replaced while the page was open" in sentence
    assert not file.exists()
    (tmp_path / "away.db").rename(file)
    assert errors(app.run()) == []


def test_another_store_file_in_its_place_is_a_sentence(stocked: Store, tmp_path: Path) -> None:
    app = view("mixtures")
    open_store(tmp_path / "other.db").close()
    (tmp_path / "other.db").rename(tmp_path / "lab.db")
    (sentence,) = errors(app.run())
    assert "or end the page and start it anew" in sentence


def test_a_store_of_an_older_revision_is_a_sentence(
    old_store: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PDLAB_STORE", str(old_store("0001")))
    st.cache_resource.clear()
    (sentence,) = errors(view("mixtures"))
    assert "pdlab db upgrade" in sentence


def test_a_locked_store_is_a_sentence(lab: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(databases, "LOCK_TIMEOUT", 0.1)
    app = view("new-aggregate")
    with closing(sqlite3.connect(tmp_path / "lab.db")) as other:
        other.execute("BEGIN IMMEDIATE")
        (sentence,) = errors(typed(app))
        assert "database is locked" in sentence
    assert errors(app.run()) == []
