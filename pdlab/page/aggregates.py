"""The aggregates of the store, and their grading curves."""

import pandas as pd
import streamlit as st

from pdlab import charts, density, experiments
from pdlab.page.wording import plain
from pdlab.quantities import heading
from pdlab.store import Store


def show(target: Store) -> None:
    """Draw the view."""
    known = experiments.summaries(target)
    if not known:
        st.info("The store holds no aggregate yet. Enter one in 'New aggregate', or run `pdlab demo`.")
        return
    frame = pd.DataFrame(
        {
            "aggregate": [one.name for one in known],
            "delivery": [one.delivery for one in known],
            heading("diameter"): [one.diameter for one in known],
            heading("measured"): [one.measured.packing_density if one.measured else None for one in known],
            heading("voids_percent"): [
                density.voids_percent(one.measured.packing_density) if one.measured else None for one in known
            ],
            heading("friction"): [one.friction for one in known],
            heading("friction_low"): [one.friction_low for one in known],
            heading("friction_high"): [one.friction_high for one in known],
            heading("rolling"): [one.rolling for one in known],
            "method": [one.method for one in known],
            "source": [one.source for one in known],
        }
    )
    formats = {
        heading("diameter"): "%.2f",
        heading("measured"): "%.4f",
        heading("voids_percent"): "%.1f",
        heading("friction"): "%.4f",
        heading("friction_low"): "%.3f",
        heading("friction_high"): "%.3f",
        heading("rolling"): "%.4f",
    }
    numbers = {name: st.column_config.NumberColumn(format=text) for name, text in formats.items()}
    st.dataframe(frame, hide_index=True, column_config=numbers, key="shelf")
    for one in known:
        if one.message:
            st.warning(plain(f"{one.name}: {one.message}"))
    gradings = {f"{one.name} {one.delivery}".strip(): one.grading for one in known if one.grading is not None}
    shown = st.multiselect("Grading curves", list(gradings), default=list(gradings)[:5], key="shown")
    if shown:
        st.plotly_chart(charts.grading_curve({name: gradings[name] for name in shown}), key="curves")
