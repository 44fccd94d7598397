"""A new mixture: aggregates, shares of which the last is the rest, the combined grading while they change."""

from collections.abc import Mapping, Sequence

import streamlit as st

from pdlab import experiments
from pdlab.errors import InputError, PdlabError
from pdlab.experiments import Composed
from pdlab.page import greeting, links
from pdlab.page.gradings import compare
from pdlab.page.wording import plain
from pdlab.store import Store

MIXTURE = "mixture"  # the key of the mixture that is shown
LISTED, LEAST, MOST = 200, 2, 5  # aggregates to choose from; how many a mixture has
BASES = ("solid volume", "mass")


def show(target: Store) -> None:
    """Draw the form."""
    names = ["aggregate_id", "aggregate", "delivery"]
    _, rows = experiments.listed(target, "aggregates", (), names, "-aggregate_id", LISTED)
    known = {int(row[0]): f"{row[1]} {row[2]}".strip() for row in rows}
    if len(known) < LEAST:
        greeting.show(target, "A mixture takes two aggregates or more.")
        return
    left, right = st.columns([3, 1])
    name = left.text_input("Name of the mixture", key="mixture_name")
    basis = right.radio("Shares by", BASES, horizontal=True, key="basis")
    ids = st.multiselect(
        "Two to five aggregates", list(known), max_selections=MOST, format_func=known.__getitem__, key="parts"
    )
    if len(ids) < LEAST:
        st.info("Choose two to five aggregates.")
        return
    shares = _ask_shares(ids, known)
    if shares is None:
        return
    try:
        composed = experiments.compose(target, ids, shares, basis == BASES[1])
    except InputError as error:
        st.error(plain(str(error)))
        return
    say_unsieved(composed)
    if st.button("Save the mixture", type="primary", key="save"):
        _save(target, name, ids, shares, basis == BASES[1])
    if composed.gradings:
        compare(composed.gradings, composed.combined)


def _ask_shares(ids: Sequence[int], known: Mapping[int, str]) -> tuple[float, ...] | None:
    """Ask for all shares but the last, which is the rest; return them [-], None where they are not sound."""
    columns, texts = st.columns(len(ids)), list[str]()
    for column, key in zip(columns[:-1], ids, strict=False):
        place = f"share_{key}_of_{'_'.join(map(str, ids))}"  # other aggregates begin with equal shares again
        st.session_state.setdefault(place, f"{100.0 / len(ids):.4g}")
        texts.append(column.text_input(f"{plain(known[key])} [%]", key=place))
    read = experiments.read_shares(texts)
    columns[-1].metric(f"{plain(known[ids[-1]])}: the rest [%]", "?" if read.rest is None else f"{read.rest:.4g}")
    for column, sentence in zip(columns, read.wrong, strict=True):
        if sentence:
            column.error(plain(sentence))
    return read.shares


def say_unsieved(composed: Composed) -> None:
    """Say which aggregates have no grading, without which the mixture has none."""
    if composed.unsieved:
        names = ", ".join(composed.unsieved)
        st.warning(plain(f"No sieve analysis of {names}: the mixture's grading cannot be drawn, nor predicted."))


def _save(target: Store, name: str, ids: Sequence[int], shares: Sequence[float], by_mass: bool) -> None:
    """Register the mixture and open it, or say every problem."""
    if not name.strip():
        st.error("the mixture has no name; enter one")
        return
    try:
        st.session_state[links.OPEN] = experiments.register_mixture(target, name, ids, shares, by_mass)
    except PdlabError as error:
        for sentence in experiments.sentences(error):
            st.error(plain(sentence))
        return
    st.rerun()
