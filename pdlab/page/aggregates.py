"""The aggregates of the store: a list with a search, and their gradings beside each other and beside targets."""

from collections.abc import Mapping, Sequence

import pandas as pd
import streamlit as st

from pdlab import experiments
from pdlab.experiments import Summary
from pdlab.grading import Grading, indices, interpolated_sieves, retained_percents
from pdlab.page import greeting, links
from pdlab.page.gradings import compare
from pdlab.page.wording import MISSING, begun, digits, plain, pressed
from pdlab.quantities import QUANTITIES, heading
from pdlab.store import Store

LISTED, OVERLAID, FIRST = 200, 8, 3  # rows of the list; curves that may be and are overlaid
NAMES = "names_shown"  # of the aggregates that can be looked at, by their ids
COLUMNS = {
    "aggregate": "aggregate",
    "delivery": "delivery",
    "finest_mm": "from [mm]",
    "coarsest_mm": "to [mm]",
    "diameter_mm": heading("diameter"),
    "packing_density": heading("measured"),
    "friction": heading("friction"),
    "rolling_friction": heading("rolling"),
    "method": "method",
    "source": "source",
}
FORMATS = {"finest_mm": "%.4g", "coarsest_mm": "%.4g", "diameter_mm": "%.2f", "packing_density": "%.4f",
           "friction": "%.4f", "rolling_friction": "%.4f"}  # fmt: skip
MEANINGS = {
    "finest_mm": "the smallest grain in the pan, else the finest sieve",
    "coarsest_mm": "the coarsest sieve",
    "diameter_mm": QUANTITIES["diameter"].meaning,
    "packing_density": f"{QUANTITIES['measured'].meaning}, by the newest density test",
    "friction": f"{QUANTITIES['friction'].meaning}, calibrated",
    "rolling_friction": f"{QUANTITIES['rolling'].meaning}, calibrated",
}
CALIBRATED = ":material/tune:"


def show(target: Store) -> None:
    """Draw the view."""
    search, new = st.columns([3, 1], vertical_alignment="bottom")
    text = search.text_input("Search by name", key="search")
    with new:
        links.link("Enter a new aggregate", "new-aggregate", links.ADD)
    known = _list(target, text)
    chosen_before = {key: st.session_state[NAMES][key] for key in st.session_state.get("shown", ())}
    offered = chosen_before | known  # what is looked at stays when the search changes
    if not offered:
        return
    st.session_state.setdefault("shown", list(known)[:FIRST])
    shown = st.multiselect(
        "Gradings to look at", list(offered), max_selections=OVERLAID, format_func=offered.__getitem__, key="shown"
    )
    st.session_state[NAMES] = offered
    chosen = sorted(experiments.summaries(target, ids=shown), key=lambda one: shown.index(one.aggregate_id))
    _say(chosen)
    gradings = {_name(one.name, one.delivery): one.grading for one in chosen if one.grading is not None}
    if gradings:
        _compare(gradings)


def _name(name: str, delivery: str) -> str:
    return f"{name} {delivery}".strip()


def _list(target: Store, search: str) -> dict[int, str]:
    """Show the newest aggregates whose names hold a text; return these names by their ids."""
    where = [f"aggregate~{search.strip()}"] if search.strip() else []
    names = ["aggregate_id", *COLUMNS]
    _, rows = experiments.listed(target, "aggregates", where, names, "-aggregate_id", LISTED)
    if not rows and not where:
        greeting.show(target, "The store holds no aggregate yet.")
    elif not rows:
        st.info(plain(f"No aggregate's name holds '{search.strip()}'."))
    else:
        if len(rows) == LISTED:
            st.caption(f"The newest {LISTED}; search for others.")
        frame = pd.DataFrame(rows, columns=names).drop(columns="aggregate_id").rename(columns=COLUMNS)
        numbers = {
            COLUMNS[name]: st.column_config.NumberColumn(format=text, help=begun(MEANINGS[name]))
            for name, text in FORMATS.items()
        }
        height = min(35 * (len(rows) + 1) + 2, 324)
        st.dataframe(
            frame, hide_index=True, column_config=numbers, key="shelf", height=height, placeholder=MISSING,
            alt="The aggregates with their sizes, measured packing densities and friction coefficients",
        )  # fmt: skip
    return {row[0]: _name(row[1], row[2]) for row in rows}


def _say(chosen: Sequence[Summary]) -> None:
    """Lead to the aggregates' calibrations, to further tests and corrections; say what stands against them."""
    ways = (
        ("calibration", CALIBRATED, "Calibration of {}"),
        ("new-aggregate", links.ADD, "Add a sieve analysis or a density test of {}"),
        ("corrections", links.EDIT, "Correct {}"),
    )
    for address, sign, words in ways:
        with st.container(horizontal=True):
            for one in chosen:
                name = _name(one.name, one.delivery)
                links.link(words.format(name), address, sign, aggregate=str(one.aggregate_id))
    for one in chosen:
        if one.message:
            st.warning(plain(f"{one.name}: {pressed(one.message, 'Calibrate')}"))


def _compare(gradings: Mapping[str, Grading]) -> None:
    """Show gradings beside each other and beside the chosen targets."""
    compare(gradings)
    left, right = st.columns(2)
    with left:
        _indices(gradings)
    with right:
        _retained(gradings)


def _indices(gradings: Mapping[str, Grading]) -> None:
    st.subheader("Indices", anchor=False)
    found = {
        name: {heading(index): digits(value) for index, value in indices(one).items()} for name, one in gradings.items()
    }
    st.table(pd.DataFrame({plain(name): values for name, values in found.items()}))
    between = {sieve for one in gradings.values() for sieve in interpolated_sieves(one)}
    if between:
        names = ", ".join(f"{sieve:g}" for sieve in sorted(between, reverse=True))
        st.caption(
            f"Of the fineness modulus by ASTM, what lies on the sieves {names} mm is interpolated where not sieved."
        )


def _retained(gradings: Mapping[str, Grading]) -> None:
    st.subheader("Retained [%]", anchor=False)
    columns = {
        plain(name): dict(zip(_sieves(one), retained_percents(one), strict=True)) for name, one in gradings.items()
    }
    frame = pd.DataFrame(columns).sort_index(ascending=False)
    frame = frame.map(lambda value: "" if pd.isna(value) else f"{value:.1f}")
    frame.index = pd.Index([f"{aperture:g}" if aperture else "pan" for aperture in frame.index], name="sieve [mm]")
    st.table(frame)


def _sieves(grading: Grading) -> list[float]:
    """Return a grading's sieves [mm], 0 for the pan."""
    return [aperture if k < grading.sieves else 0.0 for k, aperture in enumerate(grading.apertures)]
