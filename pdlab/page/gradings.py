"""Gradings drawn beside the targets that are asked for."""

from collections.abc import Mapping, Sequence

import streamlit as st

from pdlab import charts, tables
from pdlab.errors import InputError
from pdlab.grading import ASTM_C33_FINE, Grading, targets
from pdlab.page.wording import plain

C33 = "ASTM C33 fine"
TARGETS = ("Fuller", "Andreassen", "0.45-power", C33)


def compare(gradings: Mapping[str, Grading], mixture: Grading | None = None) -> None:
    """Show gradings, and that of their mixture, beside each other and beside the chosen targets."""
    wanted, largest, exponent = _ask_targets(max(grading.apertures[0] for grading in gradings.values()))
    finest = min(grading.apertures[-1] for grading in gradings.values())
    try:
        size = tables.above_zero("mm")(largest)
        curves = targets(finest, size, tables.parse_number(exponent)) if wanted else {}
    except InputError as error:
        st.error(plain(str(error)))
        curves = {}
    beside = {name: curve for name, curve in curves.items() if name in wanted}
    limits = ASTM_C33_FINE if C33 in wanted else ()
    st.plotly_chart(charts.grading_curve(gradings, beside, limits, mixture), key="curves")


def _ask_targets(coarsest: float) -> tuple[Sequence[str], str, str]:
    """Ask what to compare with; return the targets, the largest size and Andreassen's exponent as texts."""
    first, second, third = st.columns([3, 1, 1])
    wanted = first.multiselect("Compare with", TARGETS, key="targets")
    largest = second.text_input(
        "Largest size D [mm]", key="largest", placeholder=f"{coarsest:g}",
        help="Of the targets' curves (d/D)^q; when empty, the coarsest sieve of those shown.",
    )  # fmt: skip
    exponent = third.text_input("Andreassen's q", key="exponent", placeholder="0.37", help="0.37 when empty.")
    return wanted, largest.strip() or f"{coarsest:g}", exponent.strip() or "0.37"
