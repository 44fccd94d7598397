"""What is looked at of all predictions: filters that stand in the address, so that they can be kept and sent."""

import datetime as dt
from collections.abc import Sequence
from typing import Any

import streamlit as st

from pdlab import experiments
from pdlab.density import COMPACTIONS
from pdlab.experiments import STATES, Filters
from pdlab.page import choosing, links
from pdlab.page.wording import plain
from pdlab.store import Store

KEPT = "filters"  # of the session, for the way back, which Streamlit takes without the address's question mark
NAMED = 1000  # aggregates to choose from
EARLIEST, LATEST = dt.date(1950, 1, 1), dt.date(2099, 12, 31)  # of the days that can be chosen
TEXT, SEVERAL, DAYS = "find", ("holds", "method", "compaction", "state"), ("since", "until")
EMPTY: dict[str, Any] = {TEXT: "", **{key: [] for key in SEVERAL}, **dict.fromkeys(DAYS)}
OF_TEST = "The day of the mixture's density test or, where that is not stated, the day when it was entered."


def ask(target: Store) -> Filters:
    """Ask for the filters, those of the address first, then those that this view was left with."""
    is_told = TEXT in st.session_state and links.came_back()  # within the view
    before = _of_address() if is_told or EMPTY.keys() & set(st.query_params) else st.session_state.get(KEPT, EMPTY)
    for key in EMPTY:
        if is_told or key not in st.session_state:
            st.session_state[key] = before[key]
    _draw(target)
    now = {key: st.session_state[key] for key in EMPTY}
    st.session_state[KEPT] = now
    links.tell({key: _written(value) for key, value in now.items() if value})
    return Filters(
        now[TEXT], tuple(now["holds"]), tuple(now["compaction"]), now["since"], now["until"], tuple(now["method"]),
        tuple(now["state"]),
    )  # fmt: skip


def clear() -> None:
    """Take all filters away; a callback, since a widget's value can be set before it is drawn only."""
    st.session_state.update(EMPTY)


def _draw(target: Store) -> None:
    """Draw the filters."""
    with st.container(horizontal=True):
        st.text_input("Search in mixtures", **choosing.filled(TEXT), width=160, placeholder="part of a name")
        _several("With an aggregate", "holds", experiments.aggregates_in_mixtures(target, NAMED), 190)
        _several("Predicted by", "method", experiments.methods_used(target), 160)
        _several("Compaction", "compaction", COMPACTIONS, 125)
        for label, key in zip(("Tested from", "Tested until"), DAYS, strict=True):
            st.date_input(label, None, EARLIEST, LATEST, **choosing.filled(key), width=130, format="YYYY-MM-DD",
                          help=OF_TEST)  # fmt: skip
        _several("State", "state", STATES, 115)


def _several(label: str, key: str, options: Sequence[str], width: int) -> None:
    """Ask for one or more of the options; what the address asks for besides is among them, and finds nothing."""
    known = list(dict.fromkeys([*options, *st.session_state[key]]))
    st.multiselect(label, known, **choosing.filled(key), width=width, placeholder="any")


def _of_address() -> dict[str, Any]:
    """Return the filters of the address; say which of them are no days."""
    out = EMPTY | {TEXT: st.query_params.get(TEXT, "")} | {key: st.query_params.get_all(key) for key in SEVERAL}
    for key in DAYS:
        if text := st.query_params.get(key):
            out[key] = _day(text)
            if out[key] is None:
                st.error(plain(f"'{text}' in the address is no day since {EARLIEST.year}; write {key}=2026-03-31"))
    return out


def _day(text: str) -> dt.date | None:
    try:
        day = dt.date.fromisoformat(text)
    except ValueError:
        return None
    return day if EARLIEST <= day <= LATEST else None


def _written(value: Any) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else [str(value)]
