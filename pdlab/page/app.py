"""The page's script, which `pdlab serve` and app.py run: it opens the store and draws the view of the address."""

from collections.abc import Callable
from functools import partial
from typing import Literal

import streamlit as st
from streamlit.navigation.page import StreamlitPage

from pdlab import experiments, store
from pdlab.errors import InputError, PdlabError, StoreError
from pdlab.page import (
    aggregates,
    calibration,
    corrections,
    links,
    mixtures,
    new_aggregate,
    predicted_vs_measured,
    proportions,
    signing_in,
)
from pdlab.page.wording import plain
from pdlab.store import Store

HOME, CORRECTIONS = "predicted-vs-measured", "corrections"
IN_BAR = "Home"  # a bar of six titles is whole on a tablet
VIEWS: dict[str, tuple[str, Callable[[Store], None]]] = {
    HOME: ("Predicted against measured", predicted_vs_measured.show),
    "aggregates": ("Aggregates", aggregates.show),
    "calibration": ("Calibration", calibration.show),
    "mixtures": ("Mixtures", mixtures.show),
    "proportions": ("Proportions", proportions.show),
    "new-aggregate": ("New aggregate", new_aggregate.show),
    CORRECTIONS: ("Correct what was entered", corrections.show),
}  # a docstring would be shown on the page; by address: title, what draws it


@st.cache_resource
def _open(url: str) -> tuple[Store, tuple[int, ...] | None]:
    return store.open_store(url), store.identity(url)


def _store() -> Store:
    """Return the open store. Raises StoreError, where its file is not the one that was opened too."""
    url = store.store_url(None)
    opened, file = _open(url)
    if store.identity(url) != file:
        raise StoreError(
            f"the file of {opened.url} was moved, deleted or replaced while the page was open; put that file back, or "
            "end the page and start it anew"
        )
    return opened


def main() -> None:
    """Draw the page: the view of the address, or the sign-in, or why there is neither."""
    st.set_page_config(page_title="pdlab", layout="wide")
    target, refused = None, ""
    try:
        if signing_in.is_admitted():
            target = _store()
    except InputError as error:
        refused = str(error)
    pages = {address: _page(address, target, refused) for address in VIEWS}
    links.keep(pages)
    entrance = st.Page(_enter, title="pdlab", url_path="entrance", default=True, visibility="hidden")
    st.navigation([entrance, *pages.values()], position="hidden" if target is None else "top").run()


def _enter() -> None:
    """Go on to the view that was asked for before a sign-in, else home."""
    address, query = signing_in.asked_for(VIEWS) or (HOME, {})
    links.go(address, **query)


def _page(address: str, target: Store | None, refused: str) -> StreamlitPage:
    title, show = VIEWS[address]
    short = IN_BAR if address == HOME else title
    visibility: Literal["visible", "hidden"] = "hidden" if address == CORRECTIONS else "visible"
    return st.Page(partial(_draw, title, show, target, refused), title=short, url_path=address, visibility=visibility)


def _draw(title: str, show: Callable[[Store], None], target: Store | None, refused: str) -> None:
    if refused:
        st.error(plain(refused))
        return
    if target is None:
        signing_in.ask()
        return
    signing_in.say()
    st.title(title, anchor=False)
    with st.container():
        links.said()
    try:
        with experiments.damage_named(target):
            show(target)
    except PdlabError as error:  # such as a database that does not answer now
        st.error(plain(str(error)))


if __name__ == "__main__":
    main()
