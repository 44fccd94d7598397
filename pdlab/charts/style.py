"""What all figures share: colours that stand on white and on black alike, layout, texts without tags."""

from collections.abc import Callable, Sequence
from typing import Any

import plotly.graph_objects as go

INK, SERIES, GRID, BAND = "#7b8794", "#3488a8", "rgba(128, 128, 128, 0.25)", "rgba(52, 136, 168, 0.18)"
LINES = ("#3488a8", "#d1495b", "#b08a20", "#4c9a5f", "#9568c4", "#d9822b", "#6285e0", "#a86a5a")
LIMITS = "rgba(209, 140, 29, 0.20)"


Drawn = dict[str, Any]
"""A series, a shape or a layout, as plotly reads it."""
MARGIN = {"l": 10, "r": 10, "t": 20, "b": 10}
"""Beside the axes [px]."""


def scatter(**series: Any) -> Drawn:
    """Return a series of points or lines."""
    return {"type": "scatter", **series}


def made(series: Sequence[Drawn], height: int, **layout: Any) -> go.Figure:
    """Return a figure of a height [px] with the letters and margins of all; without a template, which is much to copy.

    It is made at once: what is added to a figure is checked and copied several times.
    """
    style = {"template": "none", "height": height, "showlegend": False, "font": {"size": 14}, "margin": MARGIN}
    return go.Figure(list(series), style | layout)


def shown(text: str) -> str:
    """Return text that plotly shows as it stands, without its tags."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def apart(values: Sequence[float], gap: float, place: Callable[[float], float]) -> list[float]:
    """Return the rising values of which each lies by a ``gap`` from the last on an axis, so that labels stand apart."""
    out = list[float]()
    for value in values:
        if not out or place(value) - place(out[-1]) >= gap:
            out.append(value)
    return out
