"""Mixtures: one that the store holds with its prediction, or a new one; both by the address."""

from functools import partial

import pandas as pd
import streamlit as st

from pdlab import experiments, report
from pdlab.errors import UnknownName
from pdlab.experiments import Composed
from pdlab.page import choosing, composing, lab_report, links, mixture_tests, unsaved, watching
from pdlab.page.composing import MIXTURE, NEW
from pdlab.page.gradings import compare
from pdlab.page.prediction import result
from pdlab.page.wording import plain, pressed
from pdlab.store import Store

LISTED = 200  # mixtures to choose from


def show(target: Store) -> None:
    """Draw the view."""
    chosen = _choose(target)
    if chosen == NEW:
        composing.show(target)
        return
    try:
        composed = experiments.composition(target, chosen)
    except UnknownName as error:
        st.error(plain(str(error)))
        return
    wish, answer, below = st.container(), st.container(), st.container()  # what is typed below survives the answer
    with wish:
        is_waiting = _wish(target, chosen)
    with answer:
        method = result(target, composed, is_waiting)
        lab_report.offer(composed.name, partial(report.mixture, target, chosen, method))
    with below:
        mixture_tests.show(target, chosen, composed)
        _parts(composed)


def _choose(target: Store) -> int:
    """Ask for a mixture, the one of the address first; return its id, or that a new one is wanted."""
    known = {NEW: "a new mixture"} | experiments.mixture_names(target, LISTED)
    if links.OPEN in st.session_state:  # one that was saved a moment ago
        st.session_state[MIXTURE] = st.session_state.pop(links.OPEN)
    choosing.recall("mixture", MIXTURE, unsaved.WORDS, NEW)
    if (kept := st.session_state.get(MIXTURE, NEW)) not in known:  # too old for the list, or none at all
        known[kept] = f"mixture {kept}"
    chosen: int = st.selectbox("Mixture", list(known), format_func=known.__getitem__, **choosing.filled(MIXTURE))
    return choosing.keep("mixture", MIXTURE, chosen, NEW, [mixture_tests.WORD])


def _wish(target: Store, chosen: int) -> bool:
    """Offer to wish for a prediction, or show how far the one is that waits; return whether one does."""
    waiting = experiments.waiting_prediction(target, chosen)
    if waiting is None:
        _ask(target, chosen)
    else:
        watching.watch(target, waiting, partial(experiments.waiting_prediction, target, chosen))
    return waiting is not None


def _ask(target: Store, chosen: int) -> None:
    """Offer to wish for a prediction."""
    left, right = st.columns([1, 1], vertical_alignment="bottom")
    method = left.selectbox("Method", choosing.WAYS, key="way", help=choosing.WAYS_HELP)
    if right.button("Predict", type="primary", key="predict"):
        if refused := experiments.ask_prediction(target, chosen, method):
            st.error(plain(pressed(refused)))
        else:
            st.rerun()


def _parts(composed: Composed) -> None:
    """Show what a mixture is made of, and its grading."""
    st.subheader("Aggregates and grading", anchor=False)
    columns = {"by solid volume [%]": composed.shares}
    if composed.mass_shares is not None:
        columns["by mass [%]"] = composed.mass_shares
    frame = pd.DataFrame(
        {name: [f"{100.0 * share:.4g}" for share in shares] for name, shares in columns.items()},
        index=pd.Index([plain(name) for name in composed.names], name="aggregate"),
    )
    st.table(frame)
    composing.say_unsieved(composed)
    if composed.gradings:
        compare(composed.gradings, composed.combined)
