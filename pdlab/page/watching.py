"""A wish that is waited for: how far it is, how long it takes, a button that cancels it."""

from collections.abc import Callable

import streamlit as st

from pdlab import experiments
from pdlab.experiments import Waiting
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
    waiting = look()
    if waiting is None:
        st.rerun()
    said = "queued: it begins when a runner takes it up" if waiting.state == "queued" else "running"
    text = f"{waiting.method}, {said}, {100.0 * waiting.progress:.0f} %"
    if waiting.left is not None:
        text += f", about {duration(waiting.left)} left at the pace since it was asked for"
    st.progress(waiting.progress, text=plain(text))
    if not waiting.attended:
        st.warning(NOBODY)


def duration(seconds: float) -> str:
    """Return a time that is left in the unit that people would say it in."""
    if seconds < 60.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 3600.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
