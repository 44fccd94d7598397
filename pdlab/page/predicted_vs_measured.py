"""Predicted against measured: the newest mixtures' predictions beside their measurements."""

from collections.abc import Sequence

import pandas as pd
import streamlit as st

from pdlab import charts, experiments
from pdlab.experiments import PredictionReport
from pdlab.page import greeting
from pdlab.page.wording import plain
from pdlab.quantities import heading
from pdlab.store import Store

NEWEST = 100  # mixtures that are compared on the page; a docstring would be shown on it


def show(target: Store) -> None:
    """Draw the view."""
    reports = experiments.comparisons(target, newest=NEWEST)
    if not reports:
        greeting.show(target)
        return
    if len({report.mixture for report in reports}) == NEWEST:
        st.caption(f"The newest {NEWEST} mixtures; `pdlab ls predictions` lists all.")
    methods = list(dict.fromkeys(report.method for report in reports if report.state != "open"))
    if len(methods) > 1:
        chosen = st.radio("Method", methods, horizontal=True, key="method")
        reports = [report for report in reports if report.method == chosen or report.state == "open"]
    left, right = st.columns([3, 2])
    with left:
        st.plotly_chart(charts.parity(reports), key="parity")
        st.caption("Bands: ±0.01 and ±0.02. Bars: expected error of the prediction, standard error of the measurement.")
    with right:
        _say(reports)
    _table(reports)


def _say(reports: Sequence[PredictionReport]) -> None:
    """Say how far predictions are off, and what stands against them."""
    compared = [report for report in reports if report.difference is not None]
    if compared:
        own = sum(abs(report.difference or 0.0) for report in compared) / len(compared)
        st.metric(f"Mean absolute error over {len(compared)} mixtures", f"{own:.4f}")
        if all(report.volume_mean is not None for report in compared):  # a reference knows none
            off = [abs((report.volume_mean or 0.0) - (report.measured or 0.0)) for report in compared]
            st.metric("The same for the volume mean of the aggregates", f"{sum(off) / len(compared):.4f}")
    for report in reports:
        if report.message and report.state != "open":
            st.warning(plain(f"{report.mixture}: {report.message}"))
    missing = [report.mixture for report in reports if report.state == "open"]
    if missing:
        st.info(f"Not predicted yet: {plain(', '.join(missing))}. Run `pdlab predict`.")


def _table(reports: Sequence[PredictionReport]) -> None:
    frame = pd.DataFrame(
        {
            "mixture": [report.mixture for report in reports],
            "method": [report.method for report in reports],
            heading("predicted"): [report.packing_density for report in reports],
            heading("standard_error"): [report.standard_error for report in reports],
            heading("input_error"): [report.input_error for report in reports],
            heading("expected_error"): [report.expected_error for report in reports],
            heading("measured"): [report.measured for report in reports],
            heading("measured_error"): [report.measured_error for report in reports],
            heading("difference"): [report.difference for report in reports],
        }
    )
    numbers = {name: st.column_config.NumberColumn(format="%.4f") for name in frame.columns[2:]}
    st.dataframe(frame, hide_index=True, column_config=numbers, key="predictions")
