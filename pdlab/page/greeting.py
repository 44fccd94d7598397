"""What a store with nothing to show yet begins with: what pdlab does, the first steps, an example to look at."""

import streamlit as st

from pdlab import experiments
from pdlab.page import links
from pdlab.page.wording import plain
from pdlab.store import Store

STEPS = (
    ("Enter an aggregate: its sieve analysis and a density test", "new-aggregate"),
    ("Calibrate it: the friction at which spheres pack as densely as it was measured", "calibration"),
    ("Put two or more aggregates together", "mixtures"),
    ("Ask for the mixture's packing density", "mixtures"),
)
DONE, AHEAD = ":material/check_circle:", ":material/radio_button_unchecked:"


def show(target: Store, lacking: str = "The store holds no mixture yet.") -> None:
    """Say what is ``lacking`` and lead to the first steps; offer the example where the store is empty."""
    st.info(plain(lacking))
    st.markdown(
        "pdlab predicts how densely a mixture of aggregates packs: by spheres that fall and settle, with the friction "
        "at which each aggregate's own density test comes out as it was measured."
    )
    done = experiments.first_steps(target)
    st.subheader("First steps", anchor=False)
    for is_done, (words, address) in zip(done, STEPS, strict=True):
        links.link(f"{words} (done)" if is_done else words, address, DONE if is_done else AHEAD)
    if not done.aggregate:
        _offer_example(target)


def _offer_example(target: Store) -> None:
    """Offer the measurements that come with pdlab, so that a first prediction needs nothing typed."""
    st.subheader("Or look at an example first", anchor=False)
    st.markdown(
        "R. Feret's round pebbles: three fractions, and three mixtures of them whose packing density was measured. "
        "They come with pdlab; this puts them into the store as an import would. In a terminal, `pdlab demo` uses a "
        "store of its own."
    )
    if st.button("Load the example and predict its mixtures", type="primary", key="example"):
        first, *others = experiments.load_example(target)
        st.session_state[links.OPEN] = first
        links.go("mixtures", f"loaded: the example; {1 + len(others)} predictions are asked for", mixture=str(first))
