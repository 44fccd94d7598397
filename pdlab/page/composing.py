"""A new mixture: aggregates, shares of which the last is the rest, the combined grading while they change."""

from collections.abc import Mapping, Sequence

import streamlit as st

from pdlab import experiments
from pdlab.errors import InputError, PdlabError
from pdlab.experiments import Composed
from pdlab.page import choosing, links, unsaved
from pdlab.page.gradings import compare
from pdlab.page.unsaved import BASES, BASIS, NAME, PARTS
from pdlab.page.wording import plain, pressed
from pdlab.store import Store

MIXTURE = "mixture"  # the key of the mixture that is shown
NEW = 0  # in place of its id: one that is yet to be put together


def show(target: Store) -> None:
    """Draw the form."""
    known = choosing.named(target)
    if choosing.are_too_few(target, known, "A mixture"):
        return
    unsaved.restore(choosing.MOST)
    known |= choosing.others(target, known, PARTS)
    left, right = st.columns([3, 1])
    name = left.text_input("Name of the mixture", **choosing.filled(NAME))
    basis = right.radio(
        "Shares by", BASES, horizontal=True, **choosing.filled(BASIS),
        help="Solid volume: of the grains without the voids between them. By mass the particle densities are needed.",
    )  # fmt: skip
    ids = choosing.several(known, PARTS)
    shares = _ask_shares(ids, known) if ids else None
    unsaved.keep()
    if shares is None:
        return
    try:
        composed = experiments.compose(target, ids, shares, basis == BASES[1])
    except InputError as error:
        st.error(plain(pressed(str(error))))
        return
    say_unsieved(composed)
    if st.button("Save the mixture", type="primary", key="save"):
        _save(target, name, ids, shares, basis == BASES[1])
    if composed.gradings:
        compare(composed.gradings, composed.combined)


def _ask_shares(ids: Sequence[int], known: Mapping[int, str]) -> tuple[float, ...] | None:
    """Ask for all shares but the last, which is the rest; return them [-], None where they are not sound."""
    columns, texts = st.columns(len(ids)), list[str]()
    for k, column in enumerate(columns[:-1]):
        place = unsaved.share_key(k, ids)
        st.session_state.setdefault(place, f"{100.0 / len(ids):.4g}")
        column.caption(f"{plain(known[ids[k]])} [%]")  # a label would be read aloud with what plain puts in
        label = f"{known[ids[k]]} [%]"
        texts.append(column.text_input(label, label_visibility="collapsed", **choosing.filled(place)))
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
            st.error(plain(pressed(sentence)))
        return
    unsaved.forget()
    st.rerun()
