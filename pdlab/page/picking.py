"""What was picked in the parity chart and in the list beside it: one opens its mixture, several are listed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import streamlit as st

from pdlab.experiments import Cell, Filters

PICKED, OPENED, TURN, ROWS = "picked", "opened", "parity_turn", "rows_listed"  # in the session


@dataclass(frozen=True)
class Picked:
    """Predictions by their ids and cells of the density; ``clicked``: by one click, not by a box or a lasso."""

    ids: tuple[int, ...] = ()
    cells: tuple[Cell, ...] = ()
    clicked: bool = False


def picked(event: Mapping[str, Any]) -> Picked:
    """Return what an event of the chart says was picked: each point tells a prediction's id, or a cell."""
    selection = event.get("selection", {})
    told = [tuple(int(one) for one in point.get("customdata") or ()) for point in selection.get("points", ())]
    ids = tuple(dict.fromkeys(one[0] for one in told if len(one) == 1))
    cells = tuple(dict.fromkeys((one[0], one[1], one[2]) for one in told if len(one) == 3))
    drawn = selection.get("box") or selection.get("lasso")
    return Picked(ids, cells, not drawn and len(ids) + len(cells) == 1)


def key() -> str:
    """Return the chart's key; a new one after what was picked is given up."""
    return f"parity_{st.session_state.get(TURN, 0)}"


def note(filters: Filters) -> None:
    """Keep what is picked in the chart, under the filters that it was drawn with; the chart begins anew.

    It would go on showing its box, take clicks for a part of it, and none at all while the box is the tool.
    """
    found = picked(st.session_state.get(key(), {}))
    clear()
    st.session_state[PICKED] = filters, found


def current(filters: Filters) -> Picked:
    """Return what is picked; nothing once the filters have changed."""
    before, found = st.session_state.get(PICKED, (filters, Picked()))
    return found if before == filters else Picked()


def clear() -> None:
    """Give up what is picked."""
    st.session_state.pop(PICKED, None)
    st.session_state[TURN] = st.session_state.get(TURN, 0) + 1


def show_rows(mixtures: Sequence[int]) -> None:
    """Keep which mixtures the rows of the list show, until one is picked."""
    st.session_state[ROWS] = list(mixtures)


def open_row(event: Mapping[str, Any]) -> None:
    """Ask for the mixture of the row of the list that an event says was picked."""
    rows = event.get("selection", {}).get("rows", ())
    if rows:
        st.session_state[OPENED] = st.session_state[ROWS][rows[0]]


def opened() -> int | None:
    """Return the mixture that is asked for, once."""
    found: int | None = st.session_state.pop(OPENED, None)
    return found
