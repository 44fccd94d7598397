"""The forms of the records that can be corrected, each filled with what stands; what their texts say while typed."""

from collections.abc import Mapping, Sequence

import pandas as pd
import streamlit as st

from pdlab import experiments
from pdlab.experiments import AGGREGATE_TEXTS, SHARE, SIEVE_TEXTS, EnteredAggregate, Recorded
from pdlab.page import density_tests, gradings
from pdlab.page.wording import BASIS_LABELS, named, plain

ACROSS = 4  # texts beside each other
Texts = Mapping[str, str]


def ask(seen: Recorded, particle: float | None) -> tuple[Texts, Sequence[Texts], bool]:
    """Ask for a record's texts; return them, those of its parts, and whether nothing is marked as wrong.

    ``particle``: oven-dry particle density of the material [kg/m³].
    """
    if seen.kind == "packing_test":
        return _test(seen, particle)
    if seen.kind == "sieve_analysis":
        return _sieves(seen)
    texts = _own(seen)
    return texts, _grid(seen) if seen.parts else (), True


def forget(seen: Recorded) -> None:
    """Forget what was typed over a record."""
    density_tests.forget(_place(seen))  # the other forms lose it with their widgets


def _place(seen: Recorded) -> str:
    """Return where a record's texts stand: others, once it is of another version."""
    return f"{seen.key}_{seen.version}"


def _test(seen: Recorded, particle: float | None) -> tuple[Texts, Sequence[Texts], bool]:
    place = _place(seen)
    if not density_tests.is_asked(place):
        density_tests.put(place, seen.texts)
    texts = density_tests.ask(st.container(), place)
    read = experiments.read_test(_unmoved(texts, seen.texts), particle)
    density_tests.say(st.container(), read)
    pairs = [text.partition("=") for text in seen.entered.split("\t")]
    st.caption(plain("As it was entered: " + "; ".join(f"{named(name)} {text}" for name, _, text in pairs)))
    return texts, (), not read.wrong


def _sieves(seen: Recorded) -> tuple[Texts, Sequence[Texts], bool]:
    texts = _own(seen)
    left, right = st.columns(2, gap="medium")
    with left:
        parts = _grid(seen)
    kind = seen.parts[0].column
    typed = [_unmoved(texts, part.texts) for texts, part in zip(parts, seen.parts, strict=True)]
    entered = EnteredAggregate(
        dict.fromkeys((*AGGREGATE_TEXTS, *SIEVE_TEXTS), "")
        | {"kind": kind, "sample_mass_g": texts["sample_mass_g"], "pan_lower_mm": texts["pan_lower_mm"]}
        | {"sieve_standard": texts["standard"], "sieve_date": texts["date"]},
        [(row["aperture_mm"], row[kind]) for row in typed],
    )
    read = experiments.read_entered(entered)
    with right:
        gradings.say(read.sieves, kind)
    return texts, parts, read.is_sound


def _own(seen: Recorded) -> Texts:
    """Ask for a record's own texts."""
    out, place = dict[str, str](), _place(seen)
    for k, (name, text) in enumerate(seen.texts.items()):
        if k % ACROSS == 0:
            columns = st.columns(ACROSS, vertical_alignment="bottom")
        column, key = columns[k % ACROSS], f"{name}_of_{place}"
        if name == "density_basis":
            known = ["", *BASIS_LABELS]
            out[name] = column.selectbox(
                named(name), known, known.index(text), format_func=lambda one: BASIS_LABELS.get(one, ""), key=key
            )
        else:
            out[name] = column.text_input(named(name), text, key=key)
    return out


def _grid(seen: Recorded) -> Sequence[Texts]:
    """Ask for the texts of a record's parts in a grid, beside what was entered."""
    names = list(seen.parts[0].texts)
    heads = {name: named(name) if name != SHARE else "share [%]" for name in names}
    beside = "aggregate" if SHARE in names else "entered"
    base = pd.DataFrame([[part.entered, *part.texts.values()] for part in seen.parts], columns=[beside, *names])
    columns = {name: st.column_config.TextColumn(heads[name]) for name in names}
    edited = st.data_editor(
        base, key=f"parts_of_{_place(seen)}", num_rows="fixed", hide_index=True, disabled=[beside],
        column_config=columns, placeholder="",
    )  # fmt: skip
    return [{name: str(row[name]) for name in names} for row in edited.fillna("").to_dict("records")]


def _unmoved(typed: Texts, seen: Texts) -> Texts:
    """Return texts as they stood where they were not typed over: a number's point in them is no guess."""
    return {name: seen[name] if text == seen[name] else text for name, text in typed.items()}
