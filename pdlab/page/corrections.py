"""Corrections: what was entered of an aggregate or a mixture, to be corrected record by record, with its history.

The address names the material, ?aggregate=3 or ?mixture=2; other views lead here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd
import streamlit as st

from pdlab import experiments
from pdlab.errors import InputError, UnknownName
from pdlab.experiments import Corrected, Recorded, RecordedMaterial
from pdlab.page import choosing, links, recorded_forms, signing_in
from pdlab.page.wording import AFRESH, MISSING, named, plain, pressed
from pdlab.quantities import heading
from pdlab.store import Store

CHOSEN, SEEN = "record_chosen", "record_seen"  # the key of the record, and the record as its corrector saw it
BY = "corrected_by"  # who corrects, where nobody signs in
OUTDATED = 5  # mixtures that are named
SHOWN = 50  # corrections that are listed


def show(target: Store) -> None:
    """Draw the view."""
    asked = next(((kind, key) for kind in experiments.MATERIALS for key in choosing.asked_ids(kind)[:1]), None)
    if asked is None:
        _lead()
        return
    try:
        material = experiments.recorded(target, *asked)
    except UnknownName as error:
        st.error(plain(str(error)))
        return
    st.subheader(plain(material.name), anchor=False)
    with st.container():
        _say_outdated(target, *asked)
    now = _choose(material, *asked)
    seen = _seen(now)
    texts, parts, is_sound = recorded_forms.ask(seen, material.particle)
    _finish(target, seen, now, texts, parts, is_sound)
    _history(material)


def _lead() -> None:
    """Lead to the views from which one comes here."""
    st.info("Choose an aggregate or a mixture: its view leads to what was entered of it.")
    links.link("Aggregates", "aggregates")
    links.link("Mixtures", "mixtures")


def _choose(material: RecordedMaterial, kind: str, key: int) -> Recorded:
    """Ask for the record that is to be corrected.

    A browser answers with what a record is called, which a correction changes: the box is another one after it.
    """
    records = {record.key: record for record in material.records}
    keys, kept = list(records), st.session_state.get(CHOSEN)
    chosen = st.selectbox(
        "Which of its records is to be corrected?", keys, keys.index(kept) if kept in keys else 0,
        format_func=lambda one: _called(records[one]) + " (the one that counts)" * records[one].current,
        key=f"record_{kind}_{key}_{'_'.join(str(record.version) for record in records.values())}",
    )  # fmt: skip
    st.session_state[CHOSEN] = chosen
    return records[chosen]


def _called(record: Recorded) -> str:
    """Return what a record is called."""
    words = {
        "sieve_analysis": "sieve analysis", "packing_test": "density test", "aggregate": "the aggregate itself",
        "mixture": "the mixture itself: name and shares",
    }[record.kind]  # fmt: skip
    if record.kind in experiments.MATERIALS:
        return words
    if record.kind == "packing_test":
        words += f", {record.texts['compaction']}, {heading(record.texts['kind'])}: {record.texts['value']}"
    day = record.texts["date"] or f"entered on {record.created_at:%Y-%m-%d}"
    return f"{words}, {day}"


def _seen(now: Recorded) -> Recorded:
    """Return a record as its corrector saw it first, whatever others have made of it meanwhile."""
    kept: Recorded | None = st.session_state.get(SEEN)
    if kept is not None and kept.key != now.key:
        recorded_forms.forget(kept)
        kept = None
    kept = kept or now
    st.session_state[SEEN] = replace(kept, address=now.address)
    return replace(kept, address=now.address)


def _finish(
    target: Store, seen: Recorded, now: Recorded, texts: Mapping[str, str], parts: Sequence[Mapping[str, str]],
    is_sound: bool,
) -> None:  # fmt: skip
    """Show what is changed, ask who corrects it and why, and save it."""
    above = st.container()  # what comes and goes here leaves the texts below in their places
    try:
        changes = seen.changes(texts, parts)
    except InputError as error:
        above.error(plain(str(error)))
        changes, is_sound = [], False
    if seen.version != now.version:
        if not changes and is_sound:
            _afresh()
            st.rerun()
        above.warning(f"Another has corrected this record since you opened it: it is version {now.version} now.")
        above.button(AFRESH, on_click=_afresh, key="afresh")
    if changes:
        names = {part.key: part.entered for part in seen.parts}
        above.table(_frame(changes, names) if names else _frame(changes, {}).drop(columns="record"), hide_index=True)
    by, why = _ask_who(seen)
    if st.button("Save the correction", type="primary", key="save_correction"):
        _save(target, seen, changes, by, why, is_sound)


def _afresh() -> None:
    """Give up what was seen of a record, and what was typed over it."""
    st.session_state.pop(SEEN, None)


def _ask_who(seen: Recorded) -> tuple[str, str]:
    """Ask who corrects, unless somebody is signed in, and why."""
    left, right = st.columns([1, 2], vertical_alignment="bottom")
    by = signing_in.signed_in()
    if by:
        left.text_input("Who corrects", by, disabled=True)
    else:
        st.session_state.setdefault("who", st.session_state.get(BY, ""))
        by = st.session_state[BY] = left.text_input("Who corrects", key="who", placeholder="your name")
    why = right.text_input("Why", key=f"why_{seen.key}_{seen.version}", placeholder="as: misread, 40.3 on the sheet")
    return by.strip(), why.strip()


def _save(target: Store, seen: Recorded, changes: Sequence[Corrected], by: str, why: str, is_sound: bool) -> None:
    """Write the correction, or say why not."""
    if not is_sound:
        st.error("not saved: mend what is marked above first")
    elif not changes:
        st.error("nothing is changed; type over what is wrong first")
    elif not by or not why:
        st.error(f"say {'why' if by else 'who corrects it'}: it stays in the history")
    else:
        try:
            made = experiments.correct_recorded(target, seen, changes, by, why)
        except InputError as error:
            st.error(plain(pressed(str(error))))
            return
        _afresh()
        if not made:
            links.say("nothing to correct: the same values, written otherwise")
        links.say("corrected: " + "; ".join(f"{named(one.column)} {one.old or MISSING} → {one.new or MISSING}"
                                            for one in made))  # fmt: skip


def _say_outdated(target: Store, kind: str, key: int) -> None:
    """Lead to the material's own view; say what is not what the store would give now, and where to press what."""
    found = experiments.outdated_of(target, kind, key, OUTDATED)
    what = ["the calibration"] * found.calibration + [f"the prediction of {name}" for name in found.mixtures.values()]
    if what:
        presses = " and ".join(["'Calibrate'"] * found.calibration + ["'Predict'"] * bool(found.mixtures))
        more = " and of more mixtures" * found.more
        st.warning(plain(f"Outdated now: {', '.join(what)}{more}. Press {presses} there:"))
    with st.container(horizontal=True):
        if kind == "aggregate":
            links.link("Its calibration", "calibration", links.THERE, aggregate=str(key))
        for mixture, name in found.mixtures.items() if kind == "aggregate" else [(key, "The mixture")]:
            links.link(name, "mixtures", links.THERE, mixture=str(mixture))


def _history(material: RecordedMaterial) -> None:
    """Show what was corrected in all of a material's records, the newest first."""
    st.subheader("What was corrected", anchor=False)
    made = material.corrections[:SHOWN]
    if not made:
        st.caption("Nothing yet.")
        return
    names = {record.key: _called(record) for record in material.records}
    names |= {part.key: f"{names[record.key]}: {part.entered}" for record in material.records for part in record.parts}
    frame = _frame([Corrected(one.row, one.column, one.before, one.after) for one in made], names)
    frame.insert(0, "when (UTC)", [f"{one.at:%Y-%m-%d %H:%M}" for one in made])
    frame["who"], frame["why"] = [plain(one.by) for one in made], [plain(one.reason or MISSING) for one in made]
    st.table(frame, hide_index=True)
    if len(material.corrections) > SHOWN:
        st.caption(f"The newest {SHOWN} of {len(material.corrections)}; `pdlab ls corrections` lists all.")


def _frame(changes: Sequence[Corrected], names: Mapping[str, str]) -> pd.DataFrame:
    """Return changes as a table; ``names``: what their rows are called, empty without."""
    return pd.DataFrame(
        {
            "record": [plain(names.get(one.address, "")) for one in changes],
            "what": [plain(named(one.column)) for one in changes],
            "before": [plain(one.old or MISSING) for one in changes],
            "after": [plain(one.new or MISSING) for one in changes],
        }
    )
