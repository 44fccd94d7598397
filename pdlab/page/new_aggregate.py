"""Enter an aggregate: its sieve analysis and its density test, checked while they are typed."""

from dataclasses import dataclass

import pandas as pd
import streamlit as st

from pdlab import charts, density, experiments, tables
from pdlab.errors import InputError, PdlabError, TableError
from pdlab.grading import KINDS, equivalent_diameter, make_grading
from pdlab.page import links
from pdlab.page.wording import plain
from pdlab.quantities import heading
from pdlab.store import Store

KIND_LABELS = {kind: heading(kind) for kind in KINDS}
DENSITY_LABELS = {kind: heading(kind) for kind in tables.DENSITY_KINDS}
BULK = tables.DENSITY_UNITS["bulk_density_kg_m3"]
BASIS_LABELS = {"oven_dry": "oven-dry", "ssd": "saturated surface-dry", "apparent": "apparent"}
EXAMPLE = "31,5\t0\n16\t1240\n8\t2560\n4\t1150\npan\t50"


@dataclass
class _Entered:
    """What the form holds, as text, by table."""

    aggregate: dict[str, str]
    sieves: list[dict[str, str]]
    test: dict[str, str]


def show(target: Store) -> None:
    """Draw the view."""
    left, right = st.columns(2)
    with left:
        st.subheader("Sieve analysis")
        name = st.text_input("Name of the aggregate", key="name")
        delivery = st.text_input("Delivery (empty for the first)", key="delivery")
        kind = st.selectbox(
            "The second column holds", list(KIND_LABELS), format_func=KIND_LABELS.__getitem__, key="kind"
        )
        text = st.text_area(
            "Sieve table: aperture in mm (or pan) and value in each line; type or paste", key="sieves", height=220,
            placeholder=EXAMPLE,
        )  # fmt: skip
        mass = pan = ""
        if kind == "retained_g":
            mass = st.text_input("Sample mass [g] (empty when unknown)", key="sample_mass")
        pan = st.text_input("Smallest grain in the pan [mm] (empty when unknown)", key="pan_lower")
    with right:
        sound, sieves = _preview(text, kind, mass, pan)
    test, aggregate, tested = _density_test()
    if st.button("Save", type="primary", key="save"):
        name, delivery = name.strip(), delivery.strip()
        if not name:
            st.error("the aggregate has no name; enter one")
        elif not text.strip():
            st.error("the sieve table is empty; enter at least one sieve with its aperture in mm")
        elif not sound or not tested:
            st.error("not saved: mend what is marked above first")
        else:
            extra = {"aggregate": name, "delivery": delivery, "sample_mass_g": mass, "pan_lower_mm": pan}
            aggregate |= {"name": name, "delivery": delivery}
            if test:
                test |= {"material": f"aggregate:{name}", "delivery": delivery}
            _save(target, _Entered(aggregate, [row | extra for row in sieves], test))


def _optional(text: str, what: str, unit: str) -> float | None:
    try:
        return tables.above_zero(unit)(text) if text.strip() else None
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _preview(text: str, kind: str, mass: str, pan: str) -> tuple[bool, list[dict[str, str]]]:
    """Show what a pasted sieve table says, its errors beside their rows; return whether it is sound."""
    st.subheader("Grading")
    if not text.strip():
        st.caption("The grading curve is drawn here while you type.")
        return False, []
    rows = tables.read_pasted(text, kind)
    try:
        mass_g, pan_mm = _optional(mass, "sample mass", "g"), _optional(pan, "smallest grain in the pan", "mm")
    except InputError as error:
        st.error(plain(str(error)))
        return False, []
    table, rows, whole = tables.check_pasted(rows, kind, mass_g, pan_mm)
    st.table(
        pd.DataFrame(
            {
                "line": [str(row.line) for row in rows],
                heading("aperture"): [plain(_aperture(row)) for row in rows],
                KIND_LABELS[kind]: [f"{row.row.value:g}" if row.row else "" for row in rows],
                "what is wrong": [plain(row.error or "") for row in rows],
            }
        ),
        hide_index=True,
    )
    for error_text in whole:
        st.error(plain(error_text))
    if table is None:
        return False, []
    grading = make_grading(table)
    for warning in grading.warnings:
        st.warning(plain(warning))
    st.plotly_chart(charts.grading_curve({"grading": grading}), key="curve")
    st.caption(f"Equivalent diameter by the rule log_mean: {equivalent_diameter(grading):.4g} mm")
    cells = [row.text for row in rows]
    return True, [_cells(line, kind) for line in cells]


def _aperture(row: tables.PastedRow) -> str:
    """Return a row's aperture, or the line as it was typed where it could not be read."""
    if row.row is None:
        return row.text.strip()
    return "pan" if row.row.aperture is None else f"{row.row.aperture:g}"


def _cells(line: str, kind: str) -> dict[str, str]:
    aperture, value = tables.split_pasted(line)
    return {"aperture_mm": aperture, kind: value}


def _density_test() -> tuple[dict[str, str], dict[str, str], bool]:
    """Ask for a density test; return its cells, the aggregate's, and whether they are sound or absent."""
    st.subheader("Density test")
    first, second, third = st.columns(3)
    with first:
        kind = st.selectbox(
            "Measured", list(DENSITY_LABELS), format_func=DENSITY_LABELS.__getitem__, key="density_kind"
        )
        value = st.text_input("Value", key="density_value")
    with second:
        compaction = st.selectbox("Compaction", density.COMPACTIONS, key="compaction")
        repeats = st.text_input("Repeats (empty when unknown)", key="repeats")
        spread = st.text_input("Standard deviation, in the unit of the value (empty when unknown)", key="spread")
    with third:
        particle = st.text_input("Particle density [kg/m³] (needed for a bulk density)", key="particle_density")
        basis = st.selectbox("Its basis", density.BASES, format_func=BASIS_LABELS.__getitem__, key="basis")
        absorption = st.text_input("Water absorption [%] (needed unless oven-dry)", key="absorption")
    aggregate = {
        "particle_density_kg_m3": particle, "density_basis": basis if particle.strip() else "",
        "water_absorption_percent": absorption,
    }  # fmt: skip
    if not value.strip():
        if repeats.strip() or spread.strip():
            st.error("the density test has no value; enter it, or empty its other fields")
        return {}, aggregate, not (repeats.strip() or spread.strip())
    test = {"compaction": compaction, kind: value, "repeats": repeats, "standard_deviation": spread}
    try:
        measured = _measured(kind, value, repeats, spread, particle, basis, absorption)
    except InputError as error:
        st.error(plain(str(error)))
        return test, aggregate, False
    left, right = st.columns(2)
    left.metric("Packing density", f"{measured.packing_density:.4f}")
    right.metric(heading("voids_percent").capitalize(), f"{density.voids_percent(measured.packing_density):.1f}")
    for warning in measured.warnings:
        st.caption(plain(warning))
    return test, aggregate, True


def _measured(
    kind: str, value: str, repeats: str, spread: str, particle: str, basis: str, absorption: str
) -> density.MeasuredPacking:
    dry = None
    if particle.strip():
        wet = tables.parse_number(absorption, "%") if absorption.strip() else None
        dry = density.oven_dry_density(tables.parse_number(particle, *BULK), basis, wet)
    return density.measured_packing(
        kind, tables.parse_number(value), dry,
        tables.parse_integer(repeats) if repeats.strip() else None,
        tables.parse_number(spread, *tables.DENSITY_UNITS[kind]) if spread.strip() else None,
    )  # fmt: skip


def _save(target: Store, entered: _Entered) -> None:
    """Register what was entered: everything, or nothing and every problem."""
    frames = {"aggregates": pd.DataFrame([entered.aggregate]), "sieves": pd.DataFrame(entered.sieves)}
    if entered.test:
        frames["packing_tests"] = pd.DataFrame([entered.test])
    try:
        experiments.register(target, tables.read_frames(frames))
    except TableError as error:
        for problem in error.problems:
            st.error(plain(problem.message if problem.column is None else f"{problem.column}: {problem.message}"))
        return
    except PdlabError as error:
        st.error(plain(str(error)))
        return
    links.go("aggregates", f"saved: {entered.aggregate['name'].strip()}")
