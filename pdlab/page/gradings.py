"""What a sieve table says while it is typed; gradings drawn beside the targets that are asked for."""

from collections.abc import Mapping, Sequence

import pandas as pd
import streamlit as st

from pdlab import charts, tables
from pdlab.errors import InputError
from pdlab.experiments import SievesRead
from pdlab.grading import ASTM_C33_FINE, Grading, equivalent_diameter, targets
from pdlab.page.wording import plain, pressed
from pdlab.quantities import heading

C33 = "ASTM C33 fine"
TARGETS = ("Fuller", "Andreassen", "0.45-power", C33)


def say(read: SievesRead, kind: str) -> None:
    """Show what a sieve table says, its errors beside their rows."""
    if not read.rows:
        st.caption("The grading curve is drawn here while you type.")
        return
    _rows(read, heading(kind))
    for sentence in read.wrong:
        st.error(plain(pressed(sentence)))
    if read.grading is not None:
        for warning in read.grading.warnings:
            st.warning(plain(pressed(warning)))
        st.plotly_chart(charts.grading_curve({"grading": read.grading}), key="curve")
        st.caption(f"Equivalent diameter by the rule log_mean: {equivalent_diameter(read.grading):.4g} mm")


def _rows(read: SievesRead, values: str) -> None:
    """Show the rows that have a value or an error, as they are read; ``values``: the heading of their values."""
    rows = [row for row in read.rows if row.row is not None or row.error]
    passing = dict(zip(read.grading.apertures, read.grading.passing, strict=True)) if read.grading else {}
    apertures = [row.row.aperture if row.row else None for row in rows]
    frame = pd.DataFrame(
        {
            "row": [str(row.line) for row in rows],
            "sieve [mm]": [plain(_sieve(row.text, aperture)) for row, aperture in zip(rows, apertures, strict=True)],
            values: [f"{row.row.value:g}" if row.row else "" for row in rows],
            "passing [%]": [f"{100.0 * passing[a]:.1f}" if a in passing else "" for a in apertures],
            "what is wrong": [plain(pressed(row.error or "")) for row in rows],
        }
    )
    wrong = any(row.error for row in rows)
    if rows:
        st.table(frame.drop(columns="passing [%]" if wrong else "what is wrong"), hide_index=True)


def _sieve(text: str, aperture: float | None) -> str:
    """Return a sieve as it is read, or as it was typed where it could not be, and of the pan."""
    return text.split("\t", maxsplit=1)[0] if aperture is None else f"{aperture:g}"


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
