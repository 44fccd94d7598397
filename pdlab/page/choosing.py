"""What several views ask for: aggregates, the newest first, and a method."""

from collections.abc import Collection, Mapping
from typing import Any

import streamlit as st

from pdlab import experiments
from pdlab.experiments import METHODS, OTHERS
from pdlab.page import greeting, links
from pdlab.page.wording import plain
from pdlab.store import Store

LISTED, LEAST, MOST = 200, 2, 5  # aggregates to choose from; how many a mixture has
WAYS = (OTHERS[1], *METHODS, OTHERS[0])  # auto first
WAYS_HELP = """
- auto: for each aggregate the first of the next three that reaches its density test
- monosized: equal spheres with friction
- monosized_rolling: with rolling resistance too, for what packs looser
- graded: spheres of every sieve class, for what packs denser
- repose: friction by the angle of repose, in place of the density test
"""


def named(target: Store, wanted: Collection[int] = ()) -> dict[int, str]:
    """Return the newest aggregates' names with deliveries by their ids, and of those that are wanted too.

    Nothing of an empty store.
    """
    known = _listed(target)
    for key in wanted if known else ():
        if key not in known:  # too old for the list, or none at all
            known |= _listed(target, f"aggregate_id={key}") or {key: f"aggregate {key}"}
    return known


def others(target: Store, known: Mapping[int, str], place: str) -> dict[int, str]:
    """Return the aggregates chosen in a ``place`` that are too old for the list; those that are gone no more."""
    found = dict[int, str]()
    for key in st.session_state.get(place, ()):
        found |= {} if key in known else _listed(target, f"aggregate_id={key}")
    gone = [key for key in st.session_state.get(place, ()) if key not in {**known, **found}]
    if gone:
        st.warning(plain(f"The store holds no aggregate {', '.join(map(str, gone))}; choose others."))
        st.session_state[place] = [key for key in st.session_state[place] if key not in gone]
    return found


def _listed(target: Store, *where: str) -> dict[int, str]:
    names = ["aggregate_id", "aggregate", "delivery"]
    _, rows = experiments.listed(target, "aggregates", where, names, "-aggregate_id", LISTED)
    return {int(row[0]): f"{row[1]} {row[2]}".strip() for row in rows}


def several(known: Mapping[int, str], key: str) -> list[int]:
    """Ask for two to five aggregates; return their ids in the order of the choice, none while they are too few."""
    ids: list[int] = st.multiselect(
        "Two to five aggregates", list(known), max_selections=MOST, format_func=known.__getitem__, **filled(key)
    )
    if len(ids) >= LEAST:
        return ids
    st.info("Choose two to five aggregates.")
    return []


def are_too_few(target: Store, known: Mapping[int, str], what: str) -> bool:
    """Return whether there are too few aggregates for what takes several, and say so."""
    if len(known) < LEAST:
        greeting.show(target, f"{what} takes two aggregates or more.")
    return len(known) < LEAST


def asked_ids(name: str, kind: str = "") -> list[int]:
    """Return the ids that the address gives by a name, of what ``kind``; none, and a sentence, where some are none."""
    text = st.query_params.get(name, "")
    ids = [links.number(word) for word in text.split(",")] if text else []
    if None in ids:
        st.warning(plain(f"'{text}' in the address is no {kind or name}; choose one."))
        return []
    return [one for one in ids if one is not None]


def filled(key: str) -> dict[str, Any]:
    """Return how a widget is drawn that the page itself fills: what a browser still loads is not emptied meanwhile.

    Streamlit hands the value over once; a run before the browser shows the widget would take what it does not say yet
    for nothing, had the value not to stay. It stays until another view is opened.
    """
    return {"key": key, "persist_state": "page"}


def recall(name: str, place: str, others: Collection[str] = (), new: int | None = None) -> None:
    """Choose in a place what the address gives by a name; else what was chosen there before another view.

    The way back leads over addresses that hold what the other view was asked for. ``others``: names by which the
    address asks for something else than what was chosen. Within the view the way back leads to ``new`` where the
    address gives nothing.
    """
    asked = asked_ids(name)
    if links.came_back() and place in st.session_state:
        st.session_state[place] = next(iter(asked), st.session_state[place] if new is None else new)
    kept = [] if any(one in st.query_params for one in others) else st.session_state.get(f"kept_{place}", [])
    for key in (asked or kept)[:1]:
        st.session_state.setdefault(place, key)


def keep(name: str, place: str, chosen: int, new: int | None = None, beside: Collection[str] = ()) -> int:
    """Keep what is chosen in a place for the way back, and in the address unless it is ``new``; return it.

    ``beside``: what else the address says stays there by these names.
    """
    st.session_state[f"kept_{place}"] = [chosen]
    if chosen != new:
        stays = {word: st.query_params[word] for word in beside if word in st.query_params}
        links.tell({name: str(chosen)} | stays)
    return chosen
