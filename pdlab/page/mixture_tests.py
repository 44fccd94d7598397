"""The density tests of a mixture: those that were entered, and the form of a further one.

What stands in the form and is not saved yet is kept in the address, ?test=of%3D4%26value%3D39.5, and for the session.
"""

from collections.abc import Mapping, Sequence
from urllib.parse import parse_qsl, urlencode

import pandas as pd
import streamlit as st

from pdlab import experiments
from pdlab.errors import PdlabError
from pdlab.experiments import Composed, DensityTest, TestRead
from pdlab.page import density_tests, links
from pdlab.page.wording import MISSING, plain
from pdlab.quantities import heading
from pdlab.store import Store

ENTER = "Enter a density test of this mixture"
WORD, OF = "test", "of"  # of the address; of what stands behind it, the mixture
KEPT = "unsaved_tests"  # the texts by mixture
SHOWN = 10  # tests of the list


def show(target: Store, mixture_id: int, composed: Composed) -> None:
    """Show a mixture's density tests and the form of a further one."""
    st.subheader("Density tests", anchor=False)
    tests = experiments.mixture_tests(target, mixture_id)
    if tests:
        _list(tests)
    place = f"of_mixture_{mixture_id}"
    begun = _restore(mixture_id, place)
    form = st.expander(ENTER, expanded=begun or not tests, key=f"form_{place}", on_change="rerun")
    if form.open:  # else a browser would draw it all the same
        with form:
            _ask(target, mixture_id, composed, place)
    elif not begun:  # what the address tells is of another mixture
        put_away()
    links.link("Correct what was entered of this mixture", "corrections", links.EDIT, mixture=str(mixture_id))


def _ask(target: Store, mixture_id: int, composed: Composed, place: str) -> None:
    """Ask for a density test, say what it means, and save it."""
    texts = density_tests.ask(st.container(), place)
    read = experiments.read_test(texts, composed.particle_density)
    told = st.container()  # what comes and goes here leaves the button in its place
    density_tests.say(told, read)
    if texts["kind"] == "bulk_density_kg_m3" and composed.undense:
        told.caption(plain(f"The particle density of {', '.join(composed.undense)} is missing: enter voids, or it."))
    if st.button("Save the density test", type="primary", key="save_test"):
        _save(target, mixture_id, composed.name, texts, read)
    _keep(mixture_id, texts)


def _list(tests: Sequence[DensityTest]) -> None:
    """Show the newest density tests as they were entered; the first is the one that counts."""
    newest = sorted(tests, key=lambda test: (test.current, test.key), reverse=True)[:SHOWN]
    columns = {
        "date": [str(test.date or MISSING) for test in newest],
        "entered": [plain(f"{heading(test.kind)}: {test.value:g}") for test in newest],
        "compaction": [test.compaction for test in newest],
        heading("measured"): [_with_error(test) for test in newest],
    }
    st.table(pd.DataFrame(columns), hide_index=True)
    if len(tests) > 1:
        st.caption(f"The first counts. The newest {SHOWN} are shown." if len(tests) > SHOWN else "The first counts.")


def _with_error(test: DensityTest) -> str:
    if test.packing_density is None or test.standard_error is None:
        return plain("; ".join(test.notes))
    return f"{test.packing_density:.4f} ± {test.standard_error:.4f}"


def _restore(mixture_id: int, place: str) -> bool:
    """Fill the form by what stood in it before, or by the address, where its texts are gone; return whether any did."""
    kept: dict[int, dict[str, str]] = st.session_state.setdefault(KEPT, {})
    is_asked, came_back = density_tests.is_asked(place), links.came_back()
    if not is_asked or came_back:
        told = dict(parse_qsl(st.query_params.get(WORD, "")))
        if told.pop(OF, "") == str(mixture_id):
            kept[mixture_id] = told if came_back else kept.get(mixture_id, told)
        elif is_asked:
            kept.pop(mixture_id, None)
        density_tests.put(place, kept.get(mixture_id, {}))
    return mixture_id in kept


def _keep(mixture_id: int, texts: Mapping[str, str]) -> None:
    """Keep what stands in the form in the address and for the session."""
    said = {name: text for name, text in texts.items() if text.strip()}
    if said.keys() <= density_tests.CHOICES.keys():  # a choice alone is nothing
        put_away()
        if mixture_id in st.session_state[KEPT]:
            st.session_state[KEPT][mixture_id] = {}
        return
    st.session_state[KEPT][mixture_id] = said
    links.tell({"mixture": str(mixture_id), WORD: urlencode({OF: mixture_id} | said)})


def put_away() -> None:
    """Take an unsaved density test out of the address."""
    if WORD in st.query_params:
        del st.query_params[WORD]


def _save(target: Store, mixture_id: int, name: str, texts: Mapping[str, str], read: TestRead) -> None:
    """Register the density test, or say why not."""
    if read.wrong:
        st.error("not saved: mend what is marked above first")
        return
    try:
        is_new = experiments.register_test(target, name, texts)
    except PdlabError as error:
        for sentence in experiments.sentences(error):
            st.error(plain(sentence))
        return
    if not is_new:
        st.warning("Not saved again: an equal test is there. If it was measured anew, give it its date.")
        return
    density_tests.forget(f"of_mixture_{mixture_id}")
    st.session_state[KEPT].pop(mixture_id)
    put_away()
    links.say(f"saved: a density test of {name}; it stands beside the prediction")
