"""Enter an aggregate: its sieve analysis and its density tests, checked while they are typed, kept as a draft."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from pdlab import experiments
from pdlab.errors import PdlabError, UnknownName
from pdlab.experiments import AGGREGATE_TEXTS, SIEVE_TEXTS, EnteredAggregate
from pdlab.page import choosing, density_tests, gradings, links, sieve_table
from pdlab.page.wording import BASIS_LABELS, LABELS, plain, pressed
from pdlab.store import Store

KIND = "aggregate"
FORM = "aggregate_form"  # in the session
AGAIN = "aggregate"  # in the address: the id of one of which a further test is entered
TESTS = ("sieve analyses", "density tests")  # of what was registered
SHOWN = 5  # drafts that are offered to be continued


@dataclass
class _Form:
    """What stands in the form: the id of its draft, that of the aggregate of which a further test is entered.

    ``kept``: what of the form is kept, None where it is filled in by us; ``held``: what the draft held when it was read
    or written last; ``untold``: whether the browser does not say the draft's address yet. Streamlit ends a run at any
    use of the session when the browser asks for the next; what is noted here does not use it.
    """

    draft: str = ""
    again: str = ""
    kept: str | None = ""
    held: Mapping[str, Any] | None = None
    untold: bool = False


def show(target: Store) -> None:
    """Draw the view."""
    _open(target)
    with st.container():  # what comes and goes here leaves the grid below in its place, and the cell that is typed in
        if st.session_state[FORM].again:
            st.info("Enter a sieve analysis, a density test or both below: they are added to this aggregate.")
        elif not st.session_state[FORM].draft:
            _offer_drafts(target)
    texts = _material()
    about = st.container()  # what is wrong with the aggregate's own texts stands below them
    left, right = st.columns(2, gap="medium")
    with left:
        st.subheader("Sieve analysis", anchor=False)
        texts |= sieve_table.ask_texts()
        sieves = sieve_table.ask_table()
    st.subheader("Density tests", anchor=False)
    boxes = density_tests.boxes()
    tests = [density_tests.ask(box, k) for k, box in enumerate(boxes)]
    st.button("Add a density test", on_click=density_tests.add, key="add_test")
    entered = EnteredAggregate(texts, sieves, tests)
    read = experiments.read_entered(entered)
    with right:
        st.subheader("Grading", anchor=False)
        gradings.say(read.sieves, texts["kind"])
    for sentence in read.wrong:
        about.error(plain(pressed(sentence)))
    for box, test in zip(boxes, read.tests, strict=True):
        density_tests.say(box, test, read.wrong)
    _keep(target, entered)
    if st.button("Save", type="primary", key="save"):
        _save(target, entered)


def _open(target: Store) -> None:
    """Put the draft of the address into the form, or the aggregate of which it wants a further test, or nothing."""
    wanted, again = st.query_params.get("draft", ""), st.query_params.get(AGAIN, "")
    is_there = "name" in st.session_state  # texts go where a view is left
    form: _Form = st.session_state.setdefault(FORM, _Form())
    form.untold = form.untold and is_there and not wanted
    if form.untold:  # sent before the browser heard of the draft
        st.query_params["draft"] = wanted = form.draft
        again = ""
    if is_there and (form.draft, form.again) == (wanted, again):
        return
    entered = EnteredAggregate(dict.fromkeys((*AGGREGATE_TEXTS, *SIEVE_TEXTS), ""))
    kept: str | None = ""
    held: Mapping[str, Any] | None = None
    try:
        if wanted:
            held = experiments.load_draft(target, links.number(wanted) or 0).content
            entered = experiments.entered_of(held)
            kept = json.dumps(entered.content())
        elif again:
            entered, kept = experiments.entered_again(target, links.number(again) or 0), None
    except UnknownName:
        gone = f"draft {wanted} is not there: it was saved or discarded" if wanted else f"no aggregate {again} is there"
        st.warning(plain(f"{gone}. This is a new one."))
        wanted = again = ""
        for word in ("draft", AGAIN):
            st.query_params.pop(word, None)
    sieve_table.fill(entered)
    density_tests.fill(entered.tests)
    texts = {**entered.texts, "density_basis": entered.texts["density_basis"] or "oven_dry"}
    for name in reversed(AGGREGATE_TEXTS):  # the name last: with it all is there
        st.session_state[name] = texts[name]
    st.session_state[FORM] = _Form(wanted, again, kept, held)


def _offer_drafts(target: Store) -> None:
    for draft in experiments.list_drafts(target, KIND, SHOWN):
        name = experiments.entered_of(draft.content).texts["name"].strip() or "without a name"
        first, second = st.columns([4, 1])
        with first:
            links.link(f"Continue the draft: {name}, {draft.saved_at:%Y-%m-%d %H:%M} UTC", "new-aggregate",
                       draft=str(draft.id))  # fmt: skip
        second.button("Discard", key=f"discard_{draft.id}", on_click=links.attempt,
                      args=(experiments.delete_draft, target, draft.id))  # fmt: skip


def _material() -> dict[str, str]:
    """Ask for the aggregate itself; return its texts."""
    name, delivery, dense, basis = st.columns(4, vertical_alignment="bottom")
    name.text_input("Name of the aggregate", **choosing.filled("name"))
    _ask(delivery, "delivery", placeholder="empty: the first")  # a help would be one more stop of the tabulator
    _ask(dense, "particle_density_kg_m3")
    basis.selectbox(LABELS["density_basis"], list(BASIS_LABELS), format_func=BASIS_LABELS.__getitem__,
                    **choosing.filled("density_basis"))  # fmt: skip
    wet, source, shape, repose, slip = st.columns(5, vertical_alignment="bottom")
    _ask(wet, "water_absorption_percent", help="Of water; needed unless oven-dry.")
    _ask(source, "source", placeholder="quarry, supplier")
    _ask(shape, "shape")
    _ask(repose, "repose_angle_deg", help="For the method repose only.")
    _ask(slip, "wall_angle_deg", help="On the wall; for the method repose only.")
    return {name: st.session_state[name] for name in AGGREGATE_TEXTS}


def _ask(column: DeltaGenerator, name: str, **how: Any) -> None:
    column.text_input(LABELS[name], **choosing.filled(name), **how)


def _keep(target: Store, entered: EnteredAggregate) -> None:
    """Keep what was changed since the last time as a draft, whose id stands in the address."""
    content, form = json.dumps(entered.content()), st.session_state[FORM]
    if form.kept is None:  # filled in by us: only what is changed from now on is a draft
        form.kept = content
    if content == form.kept or (not form.draft and entered.is_blank):
        return
    told = st.query_params.get("draft")
    before = (int(form.draft), form.held) if form.draft else ()
    number = str(experiments.save_draft(target, KIND, entered.content(), *before))
    is_parted = form.draft not in ("", number)
    form.draft, form.again, form.kept, form.held = number, "", content, json.loads(content)
    form.untold = form.untold or told != number
    if is_parted:
        st.warning("This draft was changed or saved in another window: what stands here is a draft of its own now.")
    st.query_params["draft"] = number
    st.query_params.pop(AGAIN, None)


def _save(target: Store, entered: EnteredAggregate) -> None:
    """Register what was entered: everything, or nothing and every problem; say what was there already."""
    form = st.session_state[FORM]
    try:
        done = experiments.register_entered(target, entered)
    except PdlabError as error:
        for sentence in experiments.sentences(error):
            st.error(plain(pressed(sentence)))
        return
    if not any(done.new.values()):
        st.warning("Not saved again: all of this is there already. If a test was made anew, give it its date.")
        return
    if form.draft:
        experiments.delete_draft(target, int(form.draft), form.held)
    del st.session_state["name"]
    there = sum(len(done.names.get((table, False), ())) for table in TESTS)
    but = f", but for {there} test{'s' if there > 1 else ''} that equal{'' if there > 1 else 's'} one that is there"
    links.go(
        "aggregates",
        f"saved: {entered.texts['name'].strip()}{but if there else ''}; next, calibrate it (below), or put it into a "
        "mixture and predict that",
    )
