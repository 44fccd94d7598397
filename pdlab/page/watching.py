"""A wish that is waited for: how far it is, how long it takes, a button that cancels it."""

import time
from collections.abc import Callable

import streamlit as st

from pdlab import experiments
from pdlab.errors import PdlabError
from pdlab.experiments import Pace, Waiting
from pdlab.page.wording import plain
from pdlab.store import Store

TICK = 2.0  # seconds between looks at a wish
Look = Callable[[], Waiting | None]
NOBODY = (
    "No runner is at work, so nothing will come of it yet: start one with `pdlab runner`, or `pdlab serve`, on this "
    "store. What was asked for is kept."
)


def watch(target: Store, waiting: Waiting, look: Look) -> None:
    """Show how far a wish is, beside a button that cancels it; ``look`` tells it anew, None when it has ended."""
    left, right = st.columns([3, 1], vertical_alignment="center")
    with left:
        _progress(look)
    if right.button("Cancel", key="cancel"):
        experiments.cancel(target, [waiting.key])
        st.rerun()


@st.fragment(run_every=TICK)
def _progress(look: Look) -> None:
    try:
        waiting = look()
    except PdlabError as error:  # a look alone runs past what draws the view
        st.error(plain(str(error)))
        return
    if waiting is None:
        st.rerun()
    said = "queued: it begins when a runner takes it up" if waiting.state == "queued" else "running"
    text = f"{waiting.method}, {said}, {100.0 * waiting.progress:.0f} %"
    text += _left(waiting)
    st.progress(waiting.progress, text=plain(text))
    if not waiting.attended:
        st.warning(NOBODY)


def _left(waiting: Waiting) -> str:
    """Return how long a wish will take still: by how it went on while it was looked at, at most since it was asked."""
    key = f"pace_{waiting.key}"
    pace = st.session_state.get(key, Pace(waiting.progress)).look(time.monotonic(), waiting.progress)
    st.session_state[key] = pace
    if waiting.state == "running" and pace.left is not None:
        return f", about {duration(pace.left)} left"
    return "" if waiting.left is None else f", at most {duration(waiting.left)} left"


def duration(seconds: float) -> str:
    """Return a time that is left in the unit that people would say it in."""
    if seconds < 60.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 3600.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
