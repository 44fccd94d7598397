"""A new mixture: aggregates, shares of which the last is the rest, the combined grading while they change."""

from collections.abc import Mapping, Sequence

import streamlit as st

from pdlab import experiments
from pdlab.errors import InputError, PdlabError
from pdlab.experiments import Composed
from pdlab.page import choosing
from pdlab.page.gradings import compare
from pdlab.page.wording import plain
from pdlab.store import Store

MIXTURE, OPEN = "mixture", "mixture_to_open"  # keys: the mixture that is shown, one that is to be shown next
NEW = 0  # in place of a mixture's id: one that is yet to be put together
PARTS, BASIS = "parts", "basis"
BASES = ("solid volume", "mass")


def show(target: Store) -> None:
    """Draw the form."""
    known = choosing.named(target, st.session_state.get(PARTS, ()))
    if choosing.are_too_few(known, "A mixture"):
        return
    left, right = st.columns([3, 1])
    name = left.text_input("Name of the mixture", key="mixture_name")
    basis = right.radio("Shares by", BASES, horizontal=True, key=BASIS)
    ids = choosing.several(known, PARTS)
    if not ids:
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


def fill(ids: Sequence[int], shares: Sequence[float]) -> None:
    """Fill the form with aggregates and their shares of the solid volume [-] for when it is drawn next."""
    st.session_state.update({MIXTURE: NEW, PARTS: list(ids), BASIS: BASES[0]})
    for key, share in zip(ids, shares, strict=True):
        st.session_state[_place(key, ids)] = f"{100.0 * share:.6g}"


def _place(key: int, ids: Sequence[int]) -> str:
    """Return where an aggregate's share is kept: other aggregates beside it begin with equal shares again."""
    return f"share_{key}_of_{'_'.join(map(str, ids))}"


def _ask_shares(ids: Sequence[int], known: Mapping[int, str]) -> tuple[float, ...] | None:
    """Ask for all shares but the last, which is the rest; return them [-], None where they are not sound."""
    columns, texts = st.columns(len(ids)), list[str]()
    for column, key in zip(columns[:-1], ids, strict=False):
        place = _place(key, ids)
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
        st.session_state[OPEN] = experiments.register_mixture(target, name, ids, shares, by_mass)
    except PdlabError as error:
        for sentence in experiments.sentences(error):
            st.error(plain(sentence))
        return
    st.rerun()
