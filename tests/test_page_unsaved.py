"""A mixture that is not saved yet stands in the address: it survives a reload, another view, and being sent."""

from collections.abc import Mapping

from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_mixing import ids
from test_page import PAGE, lab
from test_page_mixtures import chosen, metrics, ran, said, share, stocked

from pdlab import experiments
from pdlab.page.unsaved import WORDS
from pdlab.page.unsaved import address as filled
from pdlab.store import Store

__all__ = ["lab", "stocked"]


def told(app: AppTest) -> dict[str, str]:
    """Return what the address says of an unsaved mixture."""
    params = {word: app.query_params[word] for word in WORDS if word in app.query_params}
    return {word: text if isinstance(text, str) else text[0] for word, text in params.items()}


def opened(address: Mapping[str, str]) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash("mixtures")
    for word, text in address.items():
        app.query_params[word] = text
    return ran(app)


def form(app: AppTest) -> tuple[list[int], str, str, dict[str, str]]:
    return (
        list(app.multiselect(key="parts").value),
        app.text_input(key="mixture_name").value or "",
        str(app.radio(key="basis").value),
        metrics(app),
    )


def test_an_unsaved_mixture_survives_a_reload_by_its_address(stocked: Store) -> None:
    app = share(chosen(stocked, "pebbles L", "pebbles M", "pebbles F", mixture_name="Mine & yours"), 0, "62,5")
    ran(app.radio(key="basis").set_value("mass"))
    parts = ids(stocked, "pebbles L", "pebbles M", "pebbles F")
    assert told(app) == {
        "parts": ",".join(map(str, parts)), "shares": "62.5,33.33", "name": "Mine & yours", "by": "mass",
    }  # fmt: skip
    assert form(opened(told(app))) == (parts, "Mine & yours", "mass", {"pebbles F: the rest [%]": "4.17"})


def test_an_unsaved_mixture_is_there_again_after_another_view_and_after_another_mixture(stocked: Store) -> None:
    app = share(chosen(stocked, "pebbles L", "pebbles F", mixture_name="Mine"), 0, "70")
    before = form(app)
    app._page_hash = calc_hash("aggregates")
    ran(app)
    app._page_hash = calc_hash("mixtures")
    for word in WORDS:
        app.query_params.pop(word, None)
    assert form(ran(app)) == before
    ran(app.selectbox(key="mixture").set_value(2))
    assert told(app) == {}
    assert form(ran(app.selectbox(key="mixture").set_value(0))) == before


def test_a_saved_mixture_is_no_more_unsaved(stocked: Store) -> None:
    app = chosen(stocked, "pebbles L", "pebbles F", mixture_name="Mine")
    ran(app.button(key="save").click())
    assert told(app) == {}
    assert form(ran(app.selectbox(key="mixture").set_value(0)))[:2] == ([], "")


def test_what_another_view_has_filled_in_comes_before_what_was_left(stocked: Store) -> None:
    app = chosen(stocked, "pebbles L", "pebbles F", mixture_name="Mine")
    app._page_hash = calc_hash("aggregates")
    ran(app)
    first, second = ids(stocked, "pebbles M", "pebbles F")
    app.query_params.clear()
    for word, text in filled((first, second), (0.3, 0.7)).items():
        app.query_params[word] = text
    app._page_hash = calc_hash("mixtures")
    assert form(ran(app))[:2] == ([first, second], "")
    assert metrics(app) == {"pebbles F: the rest [%]": "70"}


WRONG = [
    ({"parts": "1,999"}, "The store holds no aggregate 999"),
    ({"parts": "1,one"}, "'1,one' in the address names no aggregates"),
    ({"parts": "1,2,3,4,5,6"}, "choose two to 5 of them"),
    ({"parts": "1,2", "shares": "50,40,10"}, "the address has 3 shares for 2 aggregates"),
    ({"parts": "1,2", "shares": "much"}, "'much' is no number"),
    ({"parts": "1,1"}, "in the address names no aggregates"),
    ({"parts": "1," + "9" * 5000}, "in the address names no aggregates"),
]


def test_an_address_of_no_mixture_is_a_sentence(stocked: Store) -> None:
    for address, sentence in WRONG:
        assert any(sentence in text for text in said(opened(address))), sentence
    assert len(experiments.mixture_names(stocked, 10)) == 3
