"""The sieve table in the form: a grid of texts, filled by typing, pasting, a file, or a set of sieves."""

from collections.abc import Sequence

import pandas as pd
import streamlit as st

from pdlab import experiments, tables
from pdlab.errors import PdlabError
from pdlab.experiments import SIEVE_TEXTS, EnteredAggregate
from pdlab.grading import KINDS, SIEVE_SETS
from pdlab.page import choosing
from pdlab.page.wording import LABELS, plain
from pdlab.quantities import heading

BASE, TURN, NOW, REFUSED = "sieve_base", "sieve_turn", "sieves_now", "file_refused"
# the grid's constant base, how often it was filled anew, what stands in it, why a file was not taken
KIND_LABELS = {kind: heading(kind) for kind in KINDS}
FREE = "free apertures"
EMPTY_ROWS = 8
EXAMPLE = "31,5\t0\n16\t1240\n8\t2560\n4\t1150\npan\t50"
Rows = Sequence[tuple[str, str]]


def fill(entered: EnteredAggregate) -> None:
    """Put the texts of a draft into the widgets, before they are drawn."""
    for name in SIEVE_TEXTS:
        st.session_state[name] = entered.texts[name]
    st.session_state["kind"] = entered.texts["kind"] or KINDS[0]
    st.session_state["sieve_set"] = FREE
    _refill(entered.sieves)


def ask_texts() -> dict[str, str]:
    """Ask what the values are and how the sieving was done; return the texts."""
    first, second = st.columns(2)
    first.selectbox("Sieves", [FREE, *SIEVE_SETS], **choosing.filled("sieve_set"), on_change=_choose_set)
    second.selectbox(
        "The values are", list(KIND_LABELS), format_func=KIND_LABELS.__getitem__, **choosing.filled("kind")
    )
    mass, pan, standard, date = st.columns([3, 3, 4, 4], vertical_alignment="bottom")
    mass.text_input(LABELS["sample_mass_g"], **choosing.filled("sample_mass_g"), help="Its mass; empty when unknown.",
                    disabled=st.session_state["kind"] != "retained_g")  # fmt: skip
    pan.text_input(LABELS["pan_lower_mm"], **choosing.filled("pan_lower_mm"),
                   help="The smallest grain in the pan; empty when unknown.")  # fmt: skip
    standard.text_input(LABELS["standard"], **choosing.filled("sieve_standard"), placeholder="EN 933-1")
    date.text_input(LABELS["date"], **choosing.filled("sieve_date"), placeholder="2026-03-31")
    return {name: st.session_state[name] for name in SIEVE_TEXTS}


def ask_table() -> list[tuple[str, str]]:
    """Draw the grid; return the texts of its rows."""
    columns = {
        "sieve": st.column_config.TextColumn("sieve", help="millimetres, No. 4, 3/8 in, 63 µm, or pan"),
        "value": st.column_config.TextColumn("value"),
    }
    st.caption(
        "Sieves in mm or by name: No. 4, 3/8 in, pan. Type or paste; decimal comma or point. A sieve without a value "
        "counts as not used."
    )
    base = pd.DataFrame(st.session_state[BASE], columns=["sieve", "value"], dtype=object)
    edited = st.data_editor(
        base, key=f"sieves_{st.session_state[TURN]}", num_rows="dynamic", hide_index=True, column_config=columns,
        height=36 * (len(base) + 2), placeholder="",
    )  # fmt: skip
    rows = [(str(sieve), str(value)) for sieve, value in edited.fillna("").itertuples(index=False)]
    while rows and not any(rows[-1]):
        rows.pop()
    st.session_state[NOW] = rows
    with st.expander("Fill from a text or a file"):
        st.text_area("Sieve and value in each line", key="pasted", placeholder=EXAMPLE, height=140)
        st.button("Take the text", on_click=_take_text, key="take_text")
        st.file_uploader("CSV or Excel (.xlsx) with a sieve and a value in each row", type=["csv", "txt", "xlsx"],
                         key=f"file_{st.session_state[TURN]}", on_change=_take_file)  # fmt: skip
    for sentence in st.session_state.pop(REFUSED, ()):
        st.error(plain(sentence))
    return rows


def _refill(rows: Rows) -> None:
    """Put rows into the grid: another base, and another key, so that no edit of the old one is carried over."""
    blank = [("", "")] * max(0, EMPTY_ROWS - len(rows))
    st.session_state[BASE] = [*rows, *blank]
    st.session_state[NOW] = list(rows)
    st.session_state[TURN] = st.session_state.get(TURN, 0) + 1


def _choose_set() -> None:
    """Put the sieves of the chosen set into the grid; what has a value stays."""
    name = st.session_state["sieve_set"]
    if name == FREE:
        return
    values = {sieve.strip(): value for sieve, value in st.session_state[NOW] if value.strip()}
    sieves = [*SIEVE_SETS[name], "pan"]
    _refill([*((sieve, values.pop(sieve, "")) for sieve in sieves), *values.items()])


def _take_text() -> None:
    if st.session_state["pasted"].strip():
        _refill(tables.split_lines(st.session_state["pasted"]))
        st.session_state["pasted"] = ""


def _take_file() -> None:
    file = st.session_state[f"file_{st.session_state[TURN]}"]
    if file is None:
        return
    try:
        sheet = tables.read_sieve_file(file.name, file.getvalue())
    except PdlabError as error:
        st.session_state[REFUSED] = experiments.sentences(error)
        return
    if sheet.kind is not None:
        st.session_state["kind"] = sheet.kind
    _refill(sheet.cells)
