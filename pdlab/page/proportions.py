"""Proportions: what a sweep found of several aggregates, the densest mix, the one to test next; a wish for one."""

from collections.abc import Sequence
from functools import partial

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from pdlab import charts, experiments
from pdlab.errors import PdlabError, UnknownName
from pdlab.experiments import ListedSweep, Proportions
from pdlab.page import choosing, links, unsaved, watching
from pdlab.page.wording import plain, pressed
from pdlab.quantities import heading
from pdlab.store import Store
from pdlab.sweep import Swept

LISTED, NEW = 200, 0  # sweeps to choose from; in place of an id, a sweep that is yet to be asked for
SWEEP, OPEN, PARTS, AGGREGATES = "sweep", "sweep_to_open", "swept_parts", "aggregates"
DOUBTS = (
    "The stated errors are those of the beds and their statistics. On real beds they came out too small in places: the "
    "densest mix of three aggregates was 0.004 denser than said, more than three of its errors, and where coarse "
    "grains bear, away from the densest mix, a curve lay 0.008 too low. Put the mix together and predict it: that "
    "takes four beds of it or more, and tells its PD better."
)


def show(target: Store) -> None:
    """Draw the view."""
    chosen = _choose(target)
    if chosen == NEW:
        _new(target)
        return
    try:
        known = experiments.proportions(target, chosen)
    except UnknownName as error:
        st.error(plain(str(error)))
        return
    waiting = experiments.waiting_sweep(target, chosen)
    if waiting is not None:
        st.markdown(plain(f"Sweep of {' + '.join(known.names)}"))
        watching.watch(target, waiting, partial(experiments.waiting_sweep, target, chosen))
    elif known.result is None:
        st.warning(plain(pressed(known.message or f"The sweep is {known.state}.")))
        _again(target, known)
    else:
        _outdated(target, known)
        _result(known, known.result)


def _choose(target: Store) -> int:
    """Ask for a sweep, the one of the address first; return its id, or that a new one is wanted."""
    known = {NEW: "a new sweep"} | {one.sweep_id: _title(one) for one in experiments.newest_sweeps(target, LISTED)}
    if OPEN in st.session_state:  # one that was asked for a moment ago
        st.session_state[SWEEP] = st.session_state.pop(OPEN)
    choosing.recall(SWEEP, SWEEP, (AGGREGATES,), NEW)
    if (kept := st.session_state.get(SWEEP, NEW)) not in known:  # too old for the list, or none at all
        known[kept] = f"sweep {kept}"
    chosen: int = st.selectbox("Sweep", list(known), format_func=known.__getitem__, **choosing.filled(SWEEP))
    return choosing.keep(SWEEP, SWEEP, chosen, NEW)


def _title(one: ListedSweep) -> str:
    return f"{one.sweep_id}: {' + '.join(one.aggregates)}, {one.method}, {one.state}"


def _new(target: Store) -> None:
    """Ask for the aggregates of a sweep, those of the address first, and offer to wish for it."""
    if PARTS not in st.session_state and (asked := choosing.asked_ids(AGGREGATES, "aggregate")):
        st.session_state[PARTS] = list(dict.fromkeys(asked))[: choosing.MOST]
    known = choosing.named(target)
    if choosing.are_too_few(target, known, "A sweep"):
        return
    known |= choosing.others(target, known, PARTS)
    ids = choosing.several(known, PARTS)
    st.caption(
        "A sweep looks for the densest mix: it calibrates each aggregate, then simulates the proportions that tell "
        "most, up to 12 beds of spheres of two aggregates, 30 of three, 50 of four, 70 of five."
    )
    links.tell({AGGREGATES: ",".join(map(str, ids))} if ids else {})
    if not ids:
        return
    left, right = st.columns([1, 1], vertical_alignment="bottom")
    method = left.selectbox("Method", choosing.WAYS, key="way", help=choosing.WAYS_HELP)
    if right.button("Sweep", type="primary", key="ask"):
        _ask(target, ids, method)


def _ask(target: Store, ids: Sequence[int], method: str) -> None:
    """Wish for a sweep and open it, or say why there can be none."""
    try:
        st.session_state[OPEN] = experiments.ask_proportions(target, ids, method)
    except PdlabError as error:
        st.error(plain(pressed(str(error))))
        return
    st.rerun()


def _again(target: Store, known: Proportions) -> None:
    if st.button("Sweep again", key="again"):
        _ask(target, known.ids, known.method)


def _outdated(target: Store, known: Proportions) -> None:
    """Say why a sweep is not what the store would give now, and offer it anew."""
    for text in known.outdated:
        st.warning(plain(f"Outdated: {text}."))
    if known.outdated:
        _again(target, known)


def _result(known: Proportions, result: Swept) -> None:
    """Show the densest mix and the one to test next, and PD over the proportions."""
    best, test = result.densest, result.next_test
    first, second, third, fourth = st.columns(4)
    first.metric("Densest mix, PD", f"{best.packing_density:.4f}", f"± {best.standard_error:.4f}", delta_color="off",
                 delta_arrow="off", help="± of the simulation: beds and calibration curves.")  # fmt: skip
    second.metric(heading("input_error").capitalize(), f"{best.input_error:.4f}",
                  help="Error from the measured packing densities of the aggregates.")  # fmt: skip
    third.metric("To gain, at most", f"{best.to_gain:.4f}",
                 help="In PD, at other proportions than the densest found, with a probability of 0.95.")  # fmt: skip
    if test is not None:
        fourth.metric("To test next, PD", f"{test.packing_density:.4f}", f"± {test.error:.4f}", delta_color="off",
                      delta_arrow="off", help="± of simulation, inputs and method.")  # fmt: skip
    _mixes(known, result)
    st.plotly_chart(_figure(known, result), key="proportions")
    _captions(known)
    for text in result.warnings:
        st.warning(plain(pressed(text)))


def _mixes(known: Proportions, result: Swept) -> None:
    """Show both mixes in percent, and lead to the form that puts them together."""
    best, test = result.densest, result.next_test
    by_mass, next_by_mass = known.mass_shares
    columns = {
        "densest mix, by solid volume [%]": _percent(best.shares),
        "its interval [%]": [f"{100.0 * a:.3g} to {100.0 * b:.3g}" for a, b in zip(best.low, best.high, strict=True)],
        "by mass [%]": _percent(by_mass),
        "to test next, by solid volume [%]": _percent(None if test is None else test.shares),
        "test next, by mass [%]": _percent(next_by_mass),
    }
    frame = pd.DataFrame({name: values for name, values in columns.items() if values})
    frame.index = pd.Index([plain(name) for name in known.names], name="aggregate")
    st.table(frame)
    left, right = st.columns(2)
    with left:
        _put_together("Put the densest mix together", "densest", known.ids, best.shares)
    with right:
        if test is None:
            st.caption("To test next: nothing; all mixes that can be simulated are measured.")
        else:
            _put_together("Put the mix to test next together", "next", known.ids, test.shares)
            st.caption(plain(f"Why: {test.why}."))


def _percent(shares: Sequence[float] | None) -> list[str]:
    return [] if shares is None else [f"{100.0 * share:.4g}" for share in shares]


def _put_together(title: str, key: str, ids: Sequence[int], shares: Sequence[float]) -> None:
    """Offer to open the form of a new mixture with these aggregates and shares."""
    used = [(one, share) for one, share in zip(ids, shares, strict=True) if share > 0.0]
    if len(used) < choosing.LEAST:
        st.caption("It is one aggregate alone: there is nothing to put together.")
    elif st.button(title, key=f"together_{key}"):
        links.go("mixtures", **unsaved.address(*zip(*used, strict=True)))


def _figure(known: Proportions, result: Swept) -> go.Figure:
    if len(known.names) == 2:
        return charts.share_curve(known, result)
    if len(known.names) == 3:
        return charts.proportion_triangle(known, result)
    return charts.share_profiles(known, result)


def _captions(known: Proportions) -> None:
    """Say what is drawn, and how far it can be believed."""
    if len(known.names) > 3:
        st.caption("For each aggregate: the densest that can be had with so much of it; ± of the beds alone.")
    for name, why in known.without.items():
        st.caption(plain(f"No curve by {heading(name)}: {why}."))
    st.caption(DOUBTS)
