"""The density tests in the form: their texts, and the packing density and voids derived while they are typed."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from pdlab import density, tables
from pdlab.density import COMPACTIONS
from pdlab.experiments import TEST_TEXTS, TestRead
from pdlab.page import choosing
from pdlab.page.wording import LABELS, plain, pressed
from pdlab.quantities import QUANTITIES, heading

COUNT = "density_tests"
KIND_LABELS = {kind: QUANTITIES[kind].short for kind in tables.DENSITY_KINDS}  # the unit stands with the value
UNITS = {kind: f" [{QUANTITIES[kind].unit}]" if QUANTITIES[kind].unit else "" for kind in tables.DENSITY_KINDS}
LAST = TEST_TEXTS[-1]  # the text that is put last: with it all are there, though a run may be ended half way
CHOICES = {"kind": tables.DENSITY_KINDS, "compaction": COMPACTIONS}


def fill(tests: Sequence[Mapping[str, str]]) -> None:
    """Put the density tests of a draft into the widgets, before they are drawn; an empty one where there is none."""
    st.session_state[COUNT] = 0
    for test in tests or [{}]:
        put(st.session_state[COUNT], test)
        st.session_state[COUNT] += 1


def add() -> None:
    """Add an empty density test."""
    put(st.session_state[COUNT], {})
    st.session_state[COUNT] += 1


def boxes() -> list[DeltaGenerator]:
    """Draw a frame for each density test."""
    return [st.container(border=True) for _ in range(st.session_state[COUNT])]


def ask(box: DeltaGenerator, k: int | str) -> dict[str, str]:
    """Ask for a density test within its frame; return its texts. ``k``: of a test among several, or its place."""
    kind, value, compaction, repeats, spread = box.columns([4, 3, 3, 3, 3], vertical_alignment="bottom")
    kind.selectbox("Measured", list(KIND_LABELS), format_func=KIND_LABELS.__getitem__, **_filled(k, "kind"))
    unit = UNITS[st.session_state[_key(k, "kind")]]
    value.text_input(f"Value{unit}", **_filled(k, "value"))
    compaction.selectbox(LABELS["compaction"], COMPACTIONS, **_filled(k, "compaction"))
    repeats.text_input(LABELS["repeats"], **_filled(k, "repeats"))
    spread.text_input(LABELS["standard_deviation"] + unit, **_filled(k, "standard_deviation"),
                      help="Standard deviation of single tests.")  # fmt: skip
    wide, high, moisture, standard, date = box.columns([4, 3, 3, 3, 3], vertical_alignment="bottom")
    wide.text_input(LABELS["container_diameter_mm"], **_filled(k, "container_diameter_mm"))
    high.text_input(LABELS["container_height_mm"], **_filled(k, "container_height_mm"))
    moisture.text_input(LABELS["moisture_percent"], **_filled(k, "moisture_percent"))
    standard.text_input(LABELS["standard"], **_filled(k, "standard"), placeholder="EN 1097-3")
    date.text_input(LABELS["date"], **_filled(k, "date"), placeholder="2026-03-31")
    return {name: st.session_state[_key(k, name)] for name in TEST_TEXTS}


def is_asked(k: int | str) -> bool:
    """Return whether the widgets of a density test hold texts, which they lose with another view."""
    return _key(k, LAST) in st.session_state


def forget(k: int | str) -> None:
    """Forget the texts of a density test, so that they are put anew before it is drawn next."""
    st.session_state.pop(_key(k, LAST), None)


def say(box: DeltaGenerator, read: TestRead, said: Collection[str] = ()) -> None:
    """Say what a density test means, or what is wrong with it but for what is ``said`` already, within its frame."""
    for sentence in read.wrong:
        if sentence not in said:
            box.error(plain(pressed(sentence)))
    if read.measured is None:
        return
    left, right = box.columns([2, 1])
    packing = read.measured.packing_density
    left.metric("Packing density", f"{packing:.4f} ± {read.measured.standard_error:.4f}")
    right.metric(heading("voids_percent").capitalize(), f"{density.voids_percent(packing):.1f}")
    for warning in read.measured.warnings:
        box.caption(plain(pressed(warning)))


def _key(k: int | str, name: str) -> str:
    return f"test_{k}_{name}"


def _filled(k: int | str, name: str) -> dict[str, Any]:
    return choosing.filled(_key(k, name))


def put(k: int | str, test: Mapping[str, str]) -> None:
    """Put texts into the widgets of a density test, before they are drawn; what they lack is empty."""
    for name in TEST_TEXTS:
        text, choices = test.get(name, ""), CHOICES.get(name, ())
        st.session_state[_key(k, name)] = text if not choices or text in choices else choices[0]
