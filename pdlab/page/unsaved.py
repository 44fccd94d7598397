"""A mixture that is not saved yet, kept in the address: ?parts=1,2&shares=62.5&name=Mine&by=mass.

It survives a reload and can be sent as a link; within a session it is there again after another view.
"""

from collections.abc import Sequence

import streamlit as st

from pdlab.page import links
from pdlab.page.wording import plain

PARTS, NAME, BASIS = "parts", "mixture_name", "basis"  # keys of the form
BASES = ("solid volume", "mass")
KEPT = "unsaved_mixture"
WORDS = ("parts", "shares", "name", "by")  # of the address


def share_key(k: int, ids: Sequence[int]) -> str:
    """Return the key of the share of the aggregate in place k; other aggregates begin with equal shares again."""
    return f"share_{ids[k]}_of_{'_'.join(map(str, ids))}"


def restore(most: int) -> None:
    """Fill the form by the address, or by what stood in it before another view, once; say what cannot be read.

    The browser's Back and Forward fill it anew.

    ``most``: how many aggregates a mixture has.
    """
    is_there, came_back = PARTS in st.session_state, links.came_back()
    if is_there and not came_back:
        return
    told = {word: st.query_params[word] for word in WORDS if word in st.query_params}
    if not is_there:
        told = told or dict(st.session_state.get(KEPT, {}))
    ids = _ids(told.get("parts", ""), most)
    st.session_state[NAME] = told.get("name", "")
    st.session_state[BASIS] = BASES[told.get("by") == "mass"]
    shares = [text for text in told.get("shares", "").split(",") if text.strip()]
    if len(shares) == len(ids) - 1:
        for k, text in enumerate(shares):
            st.session_state[share_key(k, ids)] = text.strip()
    elif shares and ids:
        st.warning(
            plain(
                f"the address has {len(shares)} shares for {len(ids)} aggregates; it takes one for each but the last, "
                "which has the rest"
            )
        )
    st.session_state[PARTS] = ids  # last: with them all is there, though the browser should end this run half way


def _ids(text: str, most: int) -> list[int]:
    words = [word.strip() for word in text.split(",") if word.strip()]
    ids = list(dict.fromkeys(key for key in map(links.number, words) if key is not None))
    if len(ids) != len(words) or len(ids) > most:
        st.warning(plain(f"'{text}' in the address names no aggregates of a mixture; choose two to {most} of them"))
        return []
    return ids


def address(ids: Sequence[int], shares: Sequence[float]) -> dict[str, str]:
    """Return the address of a form that is filled with aggregates and their shares of the solid volume [-]."""
    return {"parts": ",".join(map(str, ids)), "shares": ",".join(f"{100.0 * share:.6g}" for share in shares[:-1])}


def _words() -> dict[str, str]:
    ids, name = st.session_state[PARTS], st.session_state.get(NAME, "").strip()
    shares = [st.session_state.get(share_key(k, ids), "") for k in range(len(ids) - 1)]
    told = {
        "parts": ",".join(map(str, ids)),
        "shares": ",".join(text.strip().replace(",", ".") for text in shares) if all(shares) else "",
        "name": name,
        "by": "mass" if ids and st.session_state[BASIS] == BASES[1] else "",
    }
    return {word: text for word, text in told.items() if text}


def keep() -> None:
    """Keep what stands in the form in the address and for the session."""
    st.session_state[KEPT] = _words()
    links.tell(st.session_state[KEPT])


def forget() -> None:
    """Keep no longer what has been saved: another mixture begins with an empty form."""
    ids = st.session_state[PARTS]
    for key in (KEPT, PARTS, *(share_key(k, ids) for k in range(len(ids)))):
        st.session_state.pop(key, None)
