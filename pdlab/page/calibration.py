"""An aggregate's calibration: its curve and runs, what was measured, the coefficient; a wish for one."""

from functools import partial

import streamlit as st

from pdlab import charts, experiments, report
from pdlab.errors import UnknownName
from pdlab.experiments import Explained
from pdlab.page import choosing, greeting, lab_report, links, watching
from pdlab.page.wording import begun, plain, pressed
from pdlab.quantities import label
from pdlab.store import Store

CHOSEN = "aggregate"


def show(target: Store) -> None:
    """Draw the view."""
    chosen = _choose(target)
    if chosen is None:
        return
    try:
        known = experiments.explain(target, chosen)
    except UnknownName as error:
        st.error(plain(str(error)))
        return
    waiting = experiments.waiting_calibration(target, chosen)
    if waiting is None:
        _ask(target, chosen)
    else:
        watching.watch(target, waiting, partial(experiments.waiting_calibration, target, chosen))
    _result(known)
    if known.curve is None and known.measured is not None:
        st.info("Nothing of its curve is simulated yet: press 'Calibrate'.")
    elif known.curve is not None:
        st.plotly_chart(charts.calibration_curve(known, known.curve), key="curve")
        upright = "Upright: the coefficient's interval, where the curve lies within that error. "
        st.caption(
            f"Across: the measured value ± its error. {upright if known.value is not None else ''}"
            "The axis is spaced by the root of the coefficient."
        )
    lab_report.offer(known.name, partial(report.aggregate, target, chosen))
    words = f"Add a sieve analysis or a density test of {known.name}"
    links.link(words, "new-aggregate", links.ADD, aggregate=str(chosen))


def _choose(target: Store) -> int | None:
    """Ask for an aggregate, the one of the address first; return its id."""
    asked = choosing.asked_ids("aggregate")[:1]
    known = choosing.named(target, asked)
    if not known:
        greeting.show(target, "The store holds no aggregate yet.")
        return None
    choosing.recall("aggregate", CHOSEN)
    chosen: int = st.selectbox("Aggregate", list(known), format_func=known.__getitem__, **choosing.filled(CHOSEN))
    return choosing.keep("aggregate", CHOSEN, chosen)


def _result(known: Explained) -> None:
    """Say the coefficient with its interval, the method and why, or why there is no calibration."""
    if known.message:
        st.warning(plain(begun(pressed(known.message, "Calibrate"))))
    if known.value is not None and known.curve is not None:
        first, second = st.columns(2)
        low, high = ("beyond the end" if end is None else f"{end:.4f}" for end in (known.low, known.high))
        first.metric(
            begun(label(known.curve.coefficient)), f"{known.value:.4f}", f"its interval: {low} to {high}",
            delta_color="off", delta_arrow="off",
        )  # fmt: skip
        digits = 4 if known.curve.sought == "packing_density" else 1
        second.metric(
            begun(label(known.curve.sought)) + f", measured {known.compaction}".rstrip(),
            f"{known.measured:.{digits}f} ± {known.measured_error:.{digits}f}",
        )  # fmt: skip
    if known.method:
        tried = "Method" if known.value is not None else "Method tried"
        st.markdown(plain(f"{tried}: {known.method}, {known.why}."))
    for note in known.notes:
        st.caption(plain(begun(pressed(note, "Calibrate"))))


def _ask(target: Store, chosen: int) -> None:
    """Offer to wish for a calibration."""
    left, right = st.columns([1, 1], vertical_alignment="bottom")
    method = left.selectbox("Method", choosing.WAYS, key="way", help=choosing.WAYS_HELP)
    if right.button("Calibrate", type="primary", key="calibrate"):
        if refused := experiments.ask_calibration(target, chosen, method):
            st.error(plain(pressed(refused)))
        else:
            st.rerun()
