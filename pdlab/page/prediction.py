"""What a mixture's prediction says: packing density, voids, what paste must fill; theory beside it; its bed."""

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from pdlab import charts, density, experiments
from pdlab.errors import InputError
from pdlab.experiments import Composed, PredictionReport
from pdlab.page.wording import begun, plain, pressed
from pdlab.quantities import QUANTITIES, heading
from pdlab.store import Store

DRAWN = 3000  # spheres of a bed at most: what a browser still turns smoothly
BESIDE = ("volume_mean", "furnas", "toufar", "cpm")


def result(target: Store, composed: Composed, is_waiting: bool) -> str | None:
    """Show the mixture's last prediction by each method, one at a time, or what is known without one.

    ``is_waiting``: whether the next one is asked for already, so that nobody is told to ask. Returns the method that is
    shown, None without one.
    """
    reports = experiments.comparisons(target, names=[composed.name])
    methods = [report.method for report in reports if report.state != "open"]
    if not methods:
        st.info("Not predicted yet.")
    chosen = (
        st.radio("Predicted by", methods, horizontal=True, key=f"method_{composed.name}") if len(methods) > 1 else None
    )
    report = next(one for one in reports if chosen in (None, one.method))
    if report.packing_density is not None:
        _metrics(report, report.packing_density, composed)
    for note in report.notes if methods else ():
        said = pressed(note)
        st.warning(plain(f"Before this one: {said.partition('; press ')[0]}" if is_waiting else said))
    _beside(report)
    if report.packing_density is not None and report.prediction_id is not None:
        _bed(target, report.prediction_id)
    return report.method if methods else None


def _metrics(report: PredictionReport, packing: float, composed: Composed) -> None:
    """Show the packing density with its expected error and what it means for concrete."""
    error = report.expected_error or 0.0
    first, second, third, fourth = st.columns(4)
    _metric(first, "Predicted PD", f"{packing:.4f}", f"{error:.4f}",
            "± of the simulation, of the measured aggregates, and of the method in this store.")  # fmt: skip
    _metric(
        second, heading("voids_percent").capitalize(), f"{density.voids_percent(packing):.1f}", f"{100 * error:.1f}"
    )
    bulk = heading("bulk_density_kg_m3").capitalize()
    if composed.particle_density is None:
        third.metric(bulk, "unknown")
        names = ", ".join(composed.undense)
        st.caption(plain(f"No bulk density: the particle density of {names} is missing; enter it, with its basis."))
    else:
        value, off = (density.bulk_density(one, composed.particle_density) for one in (packing, error))
        _metric(third, bulk, f"{value:.0f}", f"{off:.0f}")
    _metric(fourth, "Voids for paste [L/m³]", f"{density.void_volume(packing):.0f}", f"{1000.0 * error:.0f}",
            "In a cubic metre of the compacted aggregate: the least that paste must fill.")  # fmt: skip


def _metric(column: DeltaGenerator, name: str, value: str, error: str, help_: str | None = None) -> None:
    column.metric(name, value, f"± {error}", delta_color="off", delta_arrow="off", help=help_)


def _beside(report: PredictionReport) -> None:
    """Show the measured packing density and what theory makes of the mixture."""
    rows = {heading("predicted"): report.packing_density, heading("measured"): report.measured}
    rows |= {heading(name): getattr(report, name) for name in BESIDE}
    shown = {name: value for name, value in rows.items() if value is not None}
    if shown:
        st.subheader("Beside measurement and theory", anchor=False)
        frame = pd.DataFrame({heading("packing_density"): [f"{value:.4f}" for value in shown.values()]})
        if report.measured is not None:
            frame["minus measured"] = [
                "" if name == heading("measured") else f"{value - report.measured:+.4f}"
                for name, value in shown.items()
            ]
        frame.index = pd.Index([plain(name) for name in shown])
        st.table(frame)
        named = [name for name in BESIDE if heading(name) in shown]
        st.caption(". ".join(f"{begun(heading(name))}: {QUANTITIES[name].meaning}" for name in named) + ".")
    if report.measured is None:
        st.caption("The mixture was not measured. To compare, enter a density test of it below.")
    if report.tested_otherwise:
        st.warning(plain(begun(report.tested_otherwise)))
    if report.theory_message:
        st.caption(plain(report.theory_message))


def _bed(target: Store, prediction_id: int) -> None:
    """Draw the first bed of a prediction in three dimensions when it is asked for."""
    if not st.toggle("Show the bed in three dimensions", key=f"bed_{prediction_id}"):
        return
    try:
        bed = experiments.prediction_bed(target, prediction_id, DRAWN)
    except InputError as error:
        st.error(plain(str(error)))
        return
    st.plotly_chart(charts.bed(bed), key="spheres")
    everything = bed.total == len(bed.place)
    part = f"all {bed.total} spheres" if everything else f"of {bed.total} spheres the {len(bed.place)} in front"
    st.caption(f"Run {bed.digest[:12]}, seed {bed.seed}: {part}. `pdlab bed` writes the whole bed for ParaView.")
