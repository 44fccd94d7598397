"""Predicted against measured: how far predictions are off, and each mixture's beside its measurement."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from pdlab import charts, experiments
from pdlab.comparison import Figure
from pdlab.experiments import LISTED, Cell, Filters, Judged, Parity
from pdlab.page import filters, greeting, links, picking, watching
from pdlab.page.wording import plain, pressed
from pdlab.quantities import heading
from pdlab.store import Store

ROWS, FEW, LINKED = 200, 3, 5  # of the list; messages that are told one by one; mixtures to predict that are linked
CHART, BESIDE = 680, 400  # px; beside each other where there is room, else one below the other
HEADINGS = {
    "mixture": "mixture", "method": "method", "packing_density": heading("predicted"),
    "expected_error": heading("expected_error"), "measured": heading("measured"),
    "measured_error": heading("measured_error"), "difference": heading("difference"), "compaction": "compaction",
    "tested": "tested", "state": "state", "message": "what there is to say",
}  # fmt: skip
WAITING = {"running": "being predicted", "queued": "waiting for the runner"}
NUMBERS = ("packing_density", "expected_error", "measured", "measured_error", "difference")


def show(target: Store) -> None:
    """Draw the view."""
    if not experiments.mixture_names(target, 1):
        greeting.show(target)
        return
    asked = filters.ask(target)
    picked = picking.current(asked)
    found, figure = _parity(target, asked, picked.ids, picked.cells)
    mixture = picking.opened()
    if picked.clicked and len(found.listed) == 1:
        mixture = found.listed[0][LISTED.index("mixture_id")]
        picking.clear()
    if mixture is not None:
        links.go("mixtures", mixture=str(mixture))
    if not found.mixtures:
        st.info("No mixture meets all of these filters at once.")
        st.button("Clear the filters", on_click=filters.clear, key="clear")
        return
    with st.container(horizontal=True):
        with st.container(width=CHART):
            _chart(asked, found, figure)
        with st.container(width=BESIDE):
            _believe(asked, found)
            _say(found)
            _waiting(target, found)
    _methods(found)
    _list(target, asked, found)


def _parity(target: Store, asked: Filters, ids: Sequence[int], cells: Sequence[Cell]) -> tuple[Parity, go.Figure]:
    """Return what is shown and its chart, for all who look at the same until it may be another one."""
    return _drawn(target.url, experiments.parity_state(target), asked, tuple(ids), tuple(cells), target)


@st.cache_resource(max_entries=32, show_spinner=False)
def _drawn(
    url: str, state: str, asked: Filters, ids: tuple[int, ...], cells: tuple[Cell, ...], _target: Store
) -> tuple[Parity, go.Figure]:
    found = experiments.parity(_target, asked, ids, cells, ROWS)
    return found, charts.parity(found.points, found.density, experiments.methods_used(_target), ids)


def _chart(asked: Filters, found: Parity, figure: go.Figure) -> None:
    """Draw the chart, or say why there is none."""
    if not found.shown:
        st.info("None of these mixtures is both measured and predicted in the way that is asked for.")
        return
    tools = {"displayModeBar": True, "modeBarButtonsToRemove": ["toImage", "zoomIn2d", "zoomOut2d", "autoScale2d"]}
    st.plotly_chart(figure, key=picking.key(), on_select=partial(picking.note, asked), config=tools)
    text = "Bands: ±0.01 and ±0.02. Bars: expected error of the prediction, standard error of the measurement. "
    if found.density is not None:
        text += (
            f"{found.shown} predictions are too many for points: each square of {found.density.width:g} tells how many "
            "lie there; those that are picked are drawn with their bars. "
        )
        if found.chosen > len(found.points.ids):
            text += f"Of the {found.chosen} that are picked, {len(found.points.ids)} are drawn. "
    st.caption(text + "A click opens the mixture. To list several, take the box or the lasso above the chart.")


def _believe(asked: Filters, found: Parity) -> None:
    """Say how far predictions by the method of the most mixtures are off, beside the mean that takes no simulation."""
    judged = [one for one in found.judged if one.errors is not None and one.method in (asked.methods or [one.method])]
    if not judged:
        return
    one = judged[0]
    assert one.errors is not None
    figure = one.errors.mean_absolute
    st.metric(
        f"Mean absolute error of {plain(one.method)}, {one.compared} mixture{'' if one.compared == 1 else 's'}",
        f"{figure.value:.4f}",
        None if figure.low is None else f"{figure.low:.4f} to {figure.high:.4f} (95 %)",
        delta_color="off", delta_arrow="off",
        help="How far a prediction is from the measured packing density, in the mean of these mixtures.",
    )  # fmt: skip
    if one.volume_mean is not None:
        st.metric("The same for the volume mean of the aggregates", f"{one.volume_mean:.4f}")


def _say(found: Parity) -> None:
    """Say what stands against the predictions, and which are missing."""
    failed, outdated = found.states["failed"], found.states["outdated"]
    counts = {f"{failed} failed": failed, f"{outdated} outdated (hollow or small, left out of the figures)": outdated,
              f"{found.with_warnings} with a warning": found.with_warnings}  # fmt: skip
    told = [text for text, count in counts.items() if count]
    if told:
        alone = "; choose a state above to see these alone" if failed + outdated else ""
        st.markdown(f"Predictions: {', '.join(told)}. The list tells why{alone}.")
    if failed + outdated + found.with_warnings <= FEW:
        columns = [LISTED.index(name) for name in ("state", "mixture", "message")]
        for state, mixture, message in ([row[k] for k in columns] for row in found.listed):
            if message and state != "open":
                st.warning(plain(f"{mixture}: {pressed(message)}"))
    if found.opened:
        are = "mixture is" if found.opened == 1 else "mixtures are"
        st.info(f"{found.opened} {are} measured and not predicted yet. Open one and press 'Predict':")
        with st.container(horizontal=True):
            for key, name in list(found.open.items())[:LINKED]:
                links.link(name, "mixtures", mixture=str(key))
        if found.opened > LINKED:
            st.caption(f"and {found.opened - LINKED} more; `pdlab predict` takes them all.")
    if found.unmeasured:
        st.caption(f"{found.unmeasured} more: neither measured nor predicted.")


def _waiting(target: Store, found: Parity) -> None:
    """Say how many predictions are on their way, or that they are not."""
    counts = Counter(found.waiting.values())
    for state, words in WAITING.items():
        if count := counts[state]:
            st.info(f"{count} {'mixture is' if count == 1 else 'mixtures are'} {words}.")
    if counts and experiments.nobody_works(target):
        st.warning(watching.NOBODY)


def _methods(found: Parity) -> None:
    """Show each method's errors beside what takes no simulation."""
    if not found.judged:
        return
    st.subheader("Methods")
    rows = {plain(one.method): _judged(one, found.measured) for one in found.judged}
    st.table(pd.DataFrame.from_dict(rows, orient="index"))
    st.caption(
        "Predicted minus measured packing density with its 95 % interval; outdated predictions are left out. The last "
        "two columns: the mean absolute error over the same mixtures, had the mean of the aggregates by solid volume, "
        "or the mean of the other mixtures' measured packing densities, been the prediction."
    )
    otherwise = {one.method: one.otherwise for one in found.judged if one.otherwise}
    if otherwise:
        counts = ", ".join(f"{count} by {name}" for name, count in otherwise.items())
        st.caption(plain(f"Tested in another compaction than the method predicts, and left out too: {counts}."))
    for text, names in _no_intervals(found.judged).items():
        st.caption(plain(f"No interval for {', '.join(names)}: {text}."))


def _judged(one: Judged, measured: int) -> dict[str, str]:
    """Return a row of the table of methods."""
    row = {"mixtures compared": f"{one.compared} of {measured} measured"}
    figures = one.errors and {
        "bias": one.errors.bias, "mean_absolute_error": one.errors.mean_absolute,
        "root_mean_square_error": one.errors.root_mean_square,
    }  # fmt: skip
    for name in ("bias", "mean_absolute_error", "root_mean_square_error"):
        row[heading(name)] = _with_interval(figures[name], "+" if name == "bias" else "") if figures else ""
    for name in ("volume_mean", "best_constant"):
        value = getattr(one, name)
        row[heading(name)] = "" if value is None else f"{value:.4f}"
    return row


def _with_interval(figure: Figure, sign: str) -> str:
    text = f"{figure.value:{sign}.4f}"
    return text if figure.low is None else f"{text} ({figure.low:{sign}.4f} to {figure.high:{sign}.4f})"


def _no_intervals(judged: Sequence[Judged]) -> dict[str, list[str]]:
    """Return the methods without an interval by the reason."""
    out = dict[str, list[str]]()
    for one in judged:
        if one.errors is not None and (text := one.errors.bias.no_interval):
            out.setdefault(text, []).append(one.method)
    return out


def _list(target: Store, asked: Filters, found: Parity) -> None:
    """List the predictions that were picked, or the newest; offer all of them as a file."""
    head = st.container(horizontal=True, vertical_alignment="bottom")
    head.subheader(f"{found.chosen} picked" if found.chosen else "Newest predictions", width="content")
    if found.chosen:
        head.button("Show the newest again", on_click=picking.clear, key="unpick")
    head.download_button(
        "Download all as CSV", partial(experiments.parity_csv, target, asked), "predicted_vs_measured.csv", "text/csv",
        on_click="ignore", key="download", help="All predictions that meet the filters, with all digits.",
    )  # fmt: skip
    if len(found.listed) == ROWS:
        st.caption(f"The first {ROWS}; the file holds all that meet the filters.")
    frame = pd.DataFrame(found.listed, columns=list(LISTED))
    frame["message"] = frame["message"].map(pressed, na_action="ignore")
    waiting = frame["mixture_id"].where(frame["state"] == "open").map(found.waiting).map(WAITING)
    frame["message"] = waiting.fillna(frame["message"])
    picking.show_rows(frame["mixture_id"].tolist())
    columns: dict[str, Any] = {HEADINGS[name]: st.column_config.NumberColumn(format="%.4f") for name in NUMBERS}
    columns[HEADINGS["message"]] = st.column_config.TextColumn(width="large")
    st.caption("Tick a row to open its mixture, where 'Predict' is.")
    st.dataframe(
        frame[list(HEADINGS)].rename(columns=HEADINGS), hide_index=True, key="predictions", column_config=columns,
        on_select=_open_row, selection_mode="single-row", placeholder="",
    )  # fmt: skip


def _open_row() -> None:
    picking.open_row(st.session_state["predictions"])
