"""What several views ask for: aggregates, the newest first, and a method."""

import re
from collections.abc import Collection, Mapping

import streamlit as st

from pdlab import experiments
from pdlab.experiments import METHODS, OTHERS
from pdlab.store import Store

LISTED, LEAST, MOST = 200, 2, 5  # aggregates to choose from; how many a mixture has
WAYS = (OTHERS[1], *METHODS, OTHERS[0])  # auto first


def named(target: Store, wanted: Collection[int] = ()) -> dict[int, str]:
    """Return the newest aggregates' names with deliveries by their ids, and of those that are wanted too.

    Nothing of an empty store.
    """
    known = _listed(target)
    for key in wanted if known else ():
        if key not in known:  # too old for the list, or none at all
            known |= _listed(target, f"aggregate_id={key}") or {key: f"aggregate {key}"}
    return known


def _listed(target: Store, *where: str) -> dict[int, str]:
    names = ["aggregate_id", "aggregate", "delivery"]
    _, rows = experiments.listed(target, "aggregates", where, names, "-aggregate_id", LISTED)
    return {int(row[0]): f"{row[1]} {row[2]}".strip() for row in rows}


def several(known: Mapping[int, str], key: str) -> list[int]:
    """Ask for two to five aggregates; return their ids in the order of the choice, none while they are too few."""
    ids: list[int] = st.multiselect(
        "Two to five aggregates", list(known), max_selections=MOST, format_func=known.__getitem__, key=key
    )
    if len(ids) >= LEAST:
        return ids
    st.info("Choose two to five aggregates.")
    return []


def are_too_few(known: Mapping[int, str], what: str) -> bool:
    """Return whether there are too few aggregates for what takes several, and say so."""
    if len(known) < LEAST:
        st.info(f"{what} takes two aggregates or more. Enter them in 'New aggregate', or run `pdlab demo`.")
    return len(known) < LEAST


def asked_ids(name: str) -> list[int]:
    """Return the ids that the address gives, none where they are not numbers that ids can be."""
    text = st.query_params.get(name, "")
    return [int(one) for one in text.split(",")] if re.fullmatch(r"\d{1,9}(,\d{1,9})*", text, re.ASCII) else []
