"""The lab report to download: made when it is asked for, not when the view is drawn."""

from collections.abc import Callable
from functools import partial

import streamlit as st

from pdlab import report
from pdlab.errors import PdlabError


def offer(name: str, make: Callable[[], str]) -> None:
    """Offer the report of what has a name; ``make`` returns it as HTML. What is wrong stands in the file."""
    st.download_button(
        "Download the report", partial(_made, make), report.file_name(name), "text/html", key="report",
        on_click="ignore", help="One HTML file to print and sign; it needs no network.",
    )  # fmt: skip


def _made(make: Callable[[], str]) -> str:
    try:
        return make()
    except PdlabError as error:
        return report.refused(str(error))
