"""Ways from one view to another, and what is said there on arrival."""

from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn

import streamlit as st
from streamlit.navigation.page import StreamlitPage
from streamlit.runtime.scriptrunner import get_script_run_ctx

from pdlab import experiments
from pdlab.errors import PdlabError
from pdlab.page.wording import plain, pressed

PAGES, SAID, REFUSED = "pages", "said", "refused"
DIGITS = 9  # of an id at most: what a database takes as one
ADD, EDIT, THERE = ":material/add:", ":material/edit:", ":material/arrow_forward:"
OPEN = "mixture_to_open"  # the mixture that the view of mixtures is to show next, whatever it showed before


def keep(pages: Mapping[str, StreamlitPage]) -> None:
    """Keep the pages by their addresses for this run's links."""
    st.session_state[PAGES] = dict(pages)


def link(label: str, address: str, sign: str | None = None, **query: str) -> None:
    """Draw a link to the view at an address, with what stands behind its question mark and a ``sign`` before it."""
    st.page_link(st.session_state[PAGES][address], label=plain(label), icon=sign, query_params=query or None)


def number(text: str) -> int | None:
    """Return the id that a text of the address is, None where it can be none that a store holds."""
    return int(text) if text.isdecimal() and len(text) <= DIGITS else None


def tell(query: Mapping[str, str | Sequence[str]]) -> None:
    """Have the address say this behind its question mark, and nothing else; each writing is a step back."""
    wanted = {key: [value] if isinstance(value, str) else list(value) for key, value in query.items()}
    if {key: st.query_params.get_all(key) for key in st.query_params} != wanted:
        st.query_params.from_dict(wanted)


def came_back() -> bool:
    """Return whether the browser's Back or Forward asks: what the address says comes before what was chosen since."""
    context = get_script_run_ctx()
    return context is not None and context.is_history_navigation


def go(address: str, sentence: str = "", /, **query: str | Sequence[str]) -> NoReturn:
    """Open the view at an address and say a sentence there."""
    if sentence:
        st.session_state[SAID] = sentence
    st.switch_page(st.session_state[PAGES][address], query_params=query or None)


def say(sentence: str) -> NoReturn:
    """Draw the view anew and say a sentence above it."""
    st.session_state[SAID] = sentence
    st.rerun()


def attempt(call: Callable[..., object], *args: object) -> None:
    """Do what a button asks for before its view is drawn; what is refused is said in the view."""
    try:
        call(*args)
    except PdlabError as error:
        st.session_state[REFUSED] = experiments.sentences(error)


def said() -> None:
    """Say the sentence that another view, or this one, has left, or why an attempt was refused, once."""
    for sentence in st.session_state.pop(REFUSED, ()):
        st.error(plain(pressed(sentence)))
    if sentence := st.session_state.pop(SAID, ""):
        st.success(plain(sentence))
