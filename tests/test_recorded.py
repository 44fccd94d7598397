"""Records as their corrector sees them: texts of what stands, what differs from them, what is outdated."""

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import FormulaRunner
from test_corrections import BY_MASS

from pdlab import store as store_module
from pdlab.errors import EditedMeanwhile, InputError, ShareError, UnknownName
from pdlab.experiments import (
    SHARE,
    Recorded,
    calibrate,
    correct,
    correct_recorded,
    mixture_names,
    outdated_of,
    predict,
    recorded,
    register,
)
from pdlab.store import Store
from pdlab.tables import read_path

Folder = Callable[..., Path]
TABLES = BY_MASS | {
    "sieves": "aggregate,aperture_mm,retained_g,date\nA,31.5,0,2026-03-30\nA,No. 4,90.5,2026-03-30\n"
    "A,pan,9.5,2026-03-30\nB,8,0,\nB,4,100,\n",
}


@pytest.fixture
def filled(store: Store, folder: Folder) -> Store:
    register(store, read_path(folder(**TABLES)))
    return store


def ids(target: Store) -> dict[str, int]:
    with target.read() as session:
        found = {row.name: row.id for row in store_module.aggregates(session)}
    return found | {name: key for key, name in mixture_names(target, 9).items()}


def record(target: Store, name: str, kind: str, place: int = 0) -> Recorded:
    found = recorded(target, "mixture" if name == "M" else "aggregate", ids(target)[name])
    return [one for one in found.records if one.kind == kind][place]


def test_a_sieve_analysis_is_its_texts_beside_what_was_entered(filled: Store) -> None:
    seen = record(filled, "A", "sieve_analysis")
    assert dict(seen.texts) == {"sample_mass_g": "", "pan_lower_mm": "", "standard": "", "date": "2026-03-30"}
    assert [part.entered for part in seen.parts] == ["31.5 0", "No. 4 90.5", "pan 9.5"]
    assert [dict(part.texts) for part in seen.parts] == [
        {"aperture_mm": "31.5", "retained_g": "0"},
        {"aperture_mm": "4.75", "retained_g": "90.5"},
        {"aperture_mm": "pan", "retained_g": "9.5"},
    ]
    assert seen.changes(seen.texts, [part.texts for part in seen.parts]) == []


def test_every_record_is_shown_the_newest_of_its_kind_first(filled: Store, folder: Folder) -> None:
    more = {"packing_tests": "material,compaction,voids_percent\nA,loose,41\n"}
    register(filled, read_path(folder(**more) / "packing_tests.csv"))
    found = recorded(filled, "aggregate", ids(filled)["A"])
    assert [(one.kind, one.current) for one in found.records] == [
        ("sieve_analysis", True), ("packing_test", True), ("packing_test", False), ("aggregate", False),
    ]  # fmt: skip
    assert [one.texts.get("value") for one in found.records[1:3]] == ["41", "1560"]
    assert (found.name, found.particle, found.corrections) == ("A", 2600.0, ())


def test_what_is_typed_over_is_corrected_and_stands_in_the_history(filled: Store) -> None:
    seen = record(filled, "A", "sieve_analysis")
    parts = [dict(part.texts) for part in seen.parts]
    parts[0]["aperture_mm"] = "32"
    parts[1]["retained_g"] = "90,4 g"
    changes = seen.changes({**seen.texts, "standard": " EN 933-1 "}, parts)
    assert [(one.column, one.old, one.new) for one in changes] == [
        ("standard", None, "EN 933-1"), ("aperture_mm", "31.5", "32"), ("retained_g", "90.5", "90,4 g"),
    ]  # fmt: skip
    assert len(correct_recorded(filled, seen, changes, "Anna", "misread")) == 3
    again = recorded(filled, "aggregate", ids(filled)["A"])
    assert again.records[0].texts["standard"] == "EN 933-1"
    assert [part.texts["retained_g"] for part in again.records[0].parts] == ["0", "90.4", "9.5"]
    assert again.records[0].version == 2
    assert {(one.row, one.column, one.before, one.after, one.by, one.reason) for one in again.corrections} == {
        (seen.key, "standard", "", "EN 933-1", "Anna", "misread"),
        (seen.parts[0].key, "aperture_mm", "31.5", "32.0", "Anna", "misread"),
        (seen.parts[1].key, "retained_g", "90.5", "90.4", "Anna", "misread"),
    }


def test_a_density_test_changes_its_kind_with_its_value(filled: Store) -> None:
    seen = record(filled, "M", "packing_test")
    assert (seen.texts["kind"], seen.texts["value"]) == ("bulk_density_kg_m3", "1700")
    changes = seen.changes({**seen.texts, "kind": "voids_percent", "value": "36"})
    assert {(one.column, one.old, one.new) for one in changes} == {
        ("bulk_density_kg_m3", "1700", None), ("voids_percent", None, "36"),
    }  # fmt: skip
    correct_recorded(filled, seen, changes, "Anna", "")
    again = record(filled, "M", "packing_test")
    assert (again.texts["kind"], again.texts["value"]) == ("voids_percent", "36")


def test_shares_are_corrected_in_percent_as_they_were_entered(filled: Store) -> None:
    seen = record(filled, "M", "mixture")
    assert [(part.entered, dict(part.texts)) for part in seen.parts] == [("A", {SHARE: "50"}), ("B", {SHARE: "50"})]
    changes = seen.changes(seen.texts, [{SHARE: "60 %"}, {SHARE: "40"}])
    assert [(one.column, one.old, one.new) for one in changes] == [
        ("mass_share", "0.5", "0.6"),
        ("mass_share", "0.5", "0.4"),
    ]
    with pytest.raises(ShareError, match=r"the shares sum to 1\.1,"):
        correct_recorded(filled, seen, changes[:1], "Anna", "")
    with pytest.raises(ShareError, match=r"the shares sum to 99 %, more than 0\.11 off 100"):
        seen.changes(seen.texts, [{SHARE: "60"}, {SHARE: "39"}])
    correct_recorded(filled, seen, changes, "Anna", "swapped")
    assert [part.texts[SHARE] for part in record(filled, "M", "mixture").parts] == ["60", "40"]
    with pytest.raises(InputError, match="B: 'much' is no number"):
        seen.changes(seen.texts, [{SHARE: "60"}, {SHARE: "much"}])


def test_a_share_that_is_shown_rounded_is_not_changed_by_being_looked_at(filled: Store, folder: Folder) -> None:
    third = {"mixtures": f"mixture,aggregate,solid_volume_share\nT,A,{1 / 3}\nT,B,{2 / 3}\n"}
    register(filled, read_path(folder(**third) / "mixtures.csv"))
    seen = recorded(filled, "mixture", ids(filled)["T"]).records[0]
    assert [part.texts[SHARE] for part in seen.parts] == ["33.33333333", "66.66666667"]
    assert seen.changes({"name": "third"}, [part.texts for part in seen.parts]) == seen.changes({"name": "third"}, [
        {SHARE: "33.33333333"}, {SHARE: "66.66666667"}
    ])  # fmt: skip
    assert [one.column for one in seen.changes({"name": "third"}, [part.texts for part in seen.parts])] == ["name"]


def test_who_saw_an_older_version_is_told_who_changed_it(filled: Store) -> None:
    seen = record(filled, "A", "packing_test")
    correct(filled, {seen.address: {"repeats": "3"}}, "Ben")
    with pytest.raises(EditedMeanwhile, match="was changed since you saw it, by Ben"):
        correct_recorded(filled, seen, seen.changes({**seen.texts, "value": "1570"}), "Anna", "misread")


def test_what_a_correction_leaves_behind_is_named(filled: Store) -> None:
    known = ids(filled)
    predict(filled, FormulaRunner(filled))
    for kind, name in (("aggregate", "A"), ("mixture", "M")):
        found = outdated_of(filled, kind, known[name], 5)
        assert (found.calibration, dict(found.mixtures), found.more) == (False, {}, False)
    correct(filled, {record(filled, "A", "packing_test").address: {"bulk_density_kg_m3": "1570"}}, "Anna")
    found = outdated_of(filled, "aggregate", known["A"], 5)
    assert (found.calibration, dict(found.mixtures), found.more) == (True, {known["M"]: "M"}, False)
    assert outdated_of(filled, "aggregate", known["A"], 0).more
    assert not outdated_of(filled, "aggregate", known["B"], 5).calibration
    assert dict(outdated_of(filled, "mixture", known["M"], 5).mixtures) == {known["M"]: "M"}
    calibrate(filled, FormulaRunner(filled), ["A"])
    assert not outdated_of(filled, "aggregate", known["A"], 5).calibration
    predict(filled, FormulaRunner(filled))
    assert dict(outdated_of(filled, "mixture", known["M"], 5).mixtures) == {}


@pytest.mark.parametrize("material", ["aggregate", "mixture"])
def test_what_is_not_there_is_a_sentence(filled: Store, material: str) -> None:
    for call in (lambda: recorded(filled, material, 99), lambda: outdated_of(filled, material, 99, 5)):
        with pytest.raises(UnknownName, match=f"no {material} 99"):
            call()
