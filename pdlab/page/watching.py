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
    "No runner is at work, so nothing is predicted or calibrated now: start one in a terminal, by `pdlab runner` or "
    "`pdlab serve`, on this store. What was asked for is kept."
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
    if waiting.state == "queued":
        said = f"{ordinal(waiting.before + 1)} in line: it begins when a runner is free"
    else:
        said = f"running, {100.0 * waiting.progress:.0f} %{_left(waiting)}"
    st.progress(waiting.progress, text=plain(f"{waiting.method}, {said}"))
    if not waiting.attended:
        st.warning(NOBODY)


def _left(waiting: Waiting) -> str:
    """Return how long a wish will take still: by how it went on while it was looked at, at most since it was asked."""
    key = f"pace_{waiting.key}"
    pace = st.session_state.get(key, Pace(waiting.progress)).look(time.monotonic(), waiting.progress)
    st.session_state[key] = pace
    if pace.left is not None:
        return f", about {duration(pace.left)} left"
    return "" if waiting.left is None else f", at most {duration(waiting.left)} left"


def ordinal(number: int) -> str:
    """Return a place in line as it is said: 1st, 2nd, 3rd, 11th, 22nd."""
    ends = {1: "st", 2: "nd", 3: "rd"} if number % 100 not in (11, 12, 13) else {}
    return f"{number}{ends.get(number % 10, 'th')}"


def duration(seconds: float) -> str:
    """Return a time that is left in the unit that people would say it in."""
    if seconds < 60.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 3600.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
