"""Typing errors corrected with a history, edits that would be lost, rows that others rest on."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import sqlalchemy as sa
from conftest import FormulaRunner

from pdlab.errors import DensityError, EditedMeanwhile, GradingError, InputError, ShareError, StillNeeded, UnknownName
from pdlab.experiments import comparisons, correct, delete, predict, register, show, summaries
from pdlab.lab import SHIPPED
from pdlab.models import Aggregate, Calibration, Correction, MixtureComponent, PackingTest, Prediction, Run, SieveResult
from pdlab.store import Store, open_store
from pdlab.tables import read_path

Folder = Callable[..., Path]
BY_MASS = {
    "aggregates": "name,particle_density_kg_m3,density_basis\nA,2600,oven_dry\nB,2700,oven_dry\n",
    "sieves": "aggregate,aperture_mm,retained_g\nA,32,0\nA,16,100\nB,8,0\nB,4,100\n",
    "packing_tests": "material,compaction,bulk_density_kg_m3\nA,loose,1560\nB,loose,1566\nM,loose,1700\n",
    "mixtures": "mixture,aggregate,mass_share\nM,A,0.5\nM,B,0.5\n",
}


@pytest.fixture
def predicted(pebbles: Store) -> Store:
    predict(pebbles, FormulaRunner(pebbles))
    return pebbles


@pytest.fixture
def by_mass(store: Store, folder: Folder) -> Store:
    register(store, read_path(folder(**BY_MASS)))
    predict(store, FormulaRunner(store))
    return store


def states(store: Store) -> list[str]:
    return [report.state for report in comparisons(store)]


def shares(store: Store) -> list[float]:
    with store.read() as session:
        return list(session.scalars(sa.select(MixtureComponent.solid_volume_share)))


def test_a_correction_stands_in_the_row_and_what_it_was_in_its_history(predicted: Store) -> None:
    (done,) = correct(predicted, {"packing_test:1": {"voids_percent": "40,3 %"}}, "Anna", "misread")
    assert (done.old, done.new) == ("40.0", "40.3")
    facts = show(predicted, "packing_test:1")
    assert (facts["voids_percent"], facts["version"]) == (40.3, 2)
    assert facts["raw_text"] == "material=pebbles L\tcompaction=unstated\tvoids_percent=40.0"
    (kept,) = facts["corrections"]
    assert (kept["corrected_by"], kept["reason"], kept["old_value"]) == ("Anna", "misread", "40.0")
    assert correct(predicted, {"packing_test:1": {"voids_percent": "40.3"}}, "Anna") == []
    assert show(predicted, "packing_test:1")["version"] == 2


@pytest.mark.parametrize(
    ("row", "columns", "outdated"),
    [
        ("packing_test:1", {"voids_percent": "40.3"}, [True, True, False]),
        ("packing_test:1", {"compaction": "rodded"}, [True, True, False]),
        ("packing_test:1", {"repeats": "4", "standard_deviation": "0.5"}, [True, True, False]),
        ("sieve_result:3/1", {"aperture_mm": "10"}, [False, True, True]),
        ("aggregate:pebbles L", {"source": "a quarry", "name": "L"}, [False, False, False]),
        ("packing_test:4", {"voids_percent": "36"}, [False, False, False]),
        ("mixture:pebbles L+M 1:1", {"name": "L+M"}, [False, False, False]),
    ],
)
def test_what_rests_on_a_corrected_number_is_outdated_until_it_is_put_back(
    predicted: Store, row: str, columns: dict[str, str], outdated: list[bool]
) -> None:
    before = show(predicted, row) if not row.startswith("sieve_result") else {"aperture_mm": 10.16}
    correct(predicted, {row: columns}, "Anna")
    assert [state == "outdated" for state in states(predicted)] == outdated
    if any(outdated):
        assert any("corrected" in report.message for report in comparisons(predicted))
        back = {name: "" if before[name] is None else str(before[name]) for name in columns}
        correct(predicted, {row: back}, "Anna")
        assert states(predicted) == ["done"] * 3


def test_a_calibration_of_a_corrected_test_no_longer_counts(predicted: Store) -> None:
    correct(predicted, {"packing_test:1": {"voids_percent": "40.3"}}, "Anna")
    assert [one.friction is None for one in summaries(predicted)] == [True, False, False]
    predict(predicted, FormulaRunner(predicted))
    assert states(predicted) == ["done"] * 3
    assert [one.friction is None for one in summaries(predicted)] == [False] * 3


def test_corrected_proportions_make_the_prediction_outdated(predicted: Store) -> None:
    change = {
        "mixture_component:1/0": {"solid_volume_share": "0,6"},
        "mixture_component:1/1": {"solid_volume_share": "0,4"},
    }
    correct(predicted, change, "Anna")
    assert states(predicted) == ["outdated", "done", "done"]
    assert "the mixture was corrected since; run 'pdlab predict' again" in comparisons(predicted)[0].message
    assert show(predicted, "mixture:pebbles L+M 1:1")["version"] == 2
    predict(predicted, FormulaRunner(predicted))
    assert states(predicted) == ["done"] * 3


def test_shares_by_mass_follow_a_corrected_particle_density(by_mass: Store) -> None:
    assert states(by_mass) == ["done"]
    done = correct(by_mass, {"aggregate:A": {"particle_density_kg_m3": "2650"}}, "Anna")
    assert [one.column for one in done] == ["particle_density_kg_m3", "solid_volume_share", "solid_volume_share"]
    volumes = [0.5 / 2650.0, 0.5 / 2700.0]
    assert shares(by_mass) == pytest.approx([volume / sum(volumes) for volume in volumes])
    assert states(by_mass) == ["outdated"]
    assert show(by_mass, "mixture:M")["version"] == 2
    correct(
        by_mass, {"mixture_component:1/0": {"mass_share": "0.6"}, "mixture_component:1/1": {"mass_share": "0.4"}}, "A"
    )
    volumes = [0.6 / 2650.0, 0.4 / 2700.0]
    assert shares(by_mass) == pytest.approx([volume / sum(volumes) for volume in volumes])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"aggregate:A": {"particle_density_kg_m3": "2,650"}}, InputError, "particle_density_kg_m3: '2,650' may be"),
        ({"aggregate:A": {"particle_density_kg_m3": ""}}, DensityError, "of mixture 'M' were entered by mass"),
        ({"aggregate:A": {"particle_density_kg_m3": "2.65"}}, DensityError, "2.65 kg/m³ lies outside"),
        ({"aggregate:A": {"particle_density_kg_m3": "1500"}}, DensityError, "packing density"),
        ({"aggregate:A": {"particle_density_kg_m3": "", "density_basis": ""}}, DensityError, "particle density"),
        ({"aggregate:A": {"name": ""}}, InputError, "cannot be emptied"),
        ({"aggregate:A": {"name": "B"}}, InputError, "cannot take the name of a row that is there already"),
        ({"aggregate:A": {"id": "7"}}, InputError, "has no column 'id' to correct"),
        ({"packing_test:1": {"voids_percent": "40"}}, DensityError, "bulk_density_kg_m3 and voids_percent"),
        ({"packing_test:1": {"bulk_density_kg_m3": "2700"}}, DensityError, "packing density"),
        ({"packing_test:1": {"compaction": "shaken"}}, InputError, "'shaken' is none of"),
        ({"sieve_result:1/1": {"aperture_mm": "32"}}, GradingError, "twice"),
        ({"sieve_result:1/1": {"retained_g": "0"}}, GradingError, "nothing was retained"),
        ({"sieve_result:1/1": {"retained_percent": "50"}}, InputError, "was entered as retained_g"),
        ({"sieve_analysis:1": {"sample_mass_g": "200"}}, GradingError, "off the sample mass"),
        ({"mixture_component:1/0": {"mass_share": "0.6"}}, ShareError, "the shares sum to 1.1"),
        ({"mixture_component:1/0": {"solid_volume_share": "0.5"}}, InputError, "was entered as mass_share"),
        ({"aggregate:A": {"shape": "a"}, "aggregate:B": {"shape": "b"}}, InputError, "changes one record, not 2"),
        ({"calibration:1": {"friction": "0.1"}}, InputError, "cannot be named here"),
        ({"aggregate:C": {"shape": "a"}}, UnknownName, "no aggregate 'C'"),
        ({}, InputError, "changes one record, not 0"),
    ],
)
def test_a_correction_that_an_import_would_refuse_changes_nothing(
    by_mass: Store, changes: dict[str, dict[str, str]], error: type[InputError], message: str
) -> None:
    before = [show(by_mass, what) for what in ("aggregate:A", "mixture:M")]
    with pytest.raises(error, match=message):
        correct(by_mass, changes, "Anna")
    assert [show(by_mass, what) for what in ("aggregate:A", "mixture:M")] == before
    with by_mass.read() as session:
        assert session.scalar(sa.select(sa.func.count()).select_from(Correction)) == 0


def test_apertures_that_change_places_are_a_sentence_where_the_database_refuses_them(by_mass: Store) -> None:
    correct(by_mass, {"sieve_result:1/0": {"aperture_mm": "64"}}, "Anna")
    swap = {"sieve_result:2/0": {"retained_g": "100", "aperture_mm": "4"},
            "sieve_result:2/1": {"retained_g": "0", "aperture_mm": "8"}}  # fmt: skip
    with pytest.raises(InputError, match=r"cannot hold sieve_analysis:2 so \(.*; correct values that change places"):
        correct(by_mass, swap, "Anna")


def test_a_particle_density_is_not_corrected_without_its_basis(pebbles: Store) -> None:
    with pytest.raises(DensityError, match="go together; fill both or neither"):
        correct(pebbles, {"aggregate:pebbles L": {"particle_density_kg_m3": "2650"}}, "Anna")


def test_a_correction_names_its_author(by_mass: Store) -> None:
    with pytest.raises(InputError, match="names who makes it; give --by"):
        correct(by_mass, {"aggregate:A": {"shape": "a"}}, "  ")
    with pytest.raises(InputError, match="names who makes it; give --by"):
        delete(by_mass, "prediction:1", "")


def test_the_second_of_two_who_saw_the_same_row_is_told_who_changed_it(tmp_path: Path) -> None:
    first, second = (open_store(str(tmp_path / "lab.db")) for _ in range(2))
    register(first, read_path(SHIPPED))
    seen = [show(lab, "sieve_analysis:1")["version"] for lab in (first, second)]
    correct(first, {"sieve_result:1/1": {"aperture_mm": "40"}}, "Anna", version=seen[0])
    with pytest.raises(EditedMeanwhile, match=r"by Anna on .* UTC: it is version 2 now, you saw 1; look at it with"):
        correct(second, {"sieve_result:1/0": {"aperture_mm": "61"}}, "Bert", version=seen[1])
    with second.read() as session:
        apertures = set(session.scalars(sa.select(SieveResult.aperture_mm).where(SieveResult.sieve_analysis_id == 1)))
    assert apertures == {60.96, 40.0}
    correct(second, {"sieve_result:1/0": {"aperture_mm": "61"}}, "Bert", version=2)
    for lab in (first, second):
        lab.close()


def test_a_write_over_a_version_that_is_gone_is_told_apart_by_the_database(pebbles: Store) -> None:
    def late(connection: sa.Connection) -> None:
        connection.execute(sa.text("UPDATE packing_test SET version = 7 WHERE id = 1"))

    armed = [True]

    @sa.event.listens_for(pebbles.writer, "before_cursor_execute")
    def another_writes(connection: sa.Connection, _cursor: object, statement: str, *_: object) -> None:
        if armed and statement.startswith("UPDATE packing_test"):
            armed.clear()
            late(connection)

    with pytest.raises(EditedMeanwhile, match="changed by another at the same time"):
        correct(pebbles, {"packing_test:1": {"voids_percent": "41"}}, "Anna")
    sa.event.remove(pebbles.writer, "before_cursor_execute", another_writes)


def test_what_others_rest_on_cannot_be_deleted_and_they_are_named(predicted: Store) -> None:
    with pytest.raises(
        StillNeeded,
        match=r"on it rest 1 sieve analysis \(sieve_analysis:1\), 1 packing test \(packing_test:1\), 2 mixtures "
        r"\(mixture:pebbles L\+F 1:1, mixture:pebbles L\+M 1:1\), 1 calibration \(calibration:1\); delete those first",
    ):
        delete(predicted, "pebbles L", "Anna")
    digest = show(predicted, "prediction:1")["runs"][0]["specimen_hash"]
    for what in ("sieve_analysis:1", "packing_test:1", "calibration:1", "mixture:pebbles L+M 1:1", f"run:{digest}"):
        with pytest.raises(StillNeeded, match="delete those first"):
            delete(predicted, what, "Anna")


def test_from_the_prediction_down_everything_can_be_deleted_with_its_own_parts(predicted: Store) -> None:
    names = [f"prediction:{k}" for k in (1, 2, 3)] + [f"calibration:{k}" for k in (1, 2, 3)]
    names += [f"packing_test:{k}" for k in range(1, 7)] + [f"sieve_analysis:{k}" for k in (1, 2, 3)]
    names += ["pebbles L+M 1:1", "pebbles L+F 1:1", "pebbles M+F 1:1", "pebbles L", "pebbles M", "pebbles F"]
    with predicted.read() as session:
        names += [f"run:{digest}" for digest in session.scalars(sa.select(Run.specimen_hash))]
    for name in names:
        with pytest.raises(InputError, match="would be deleted; add --yes"):
            delete(predicted, name, "Anna", confirmed=False)
        delete(predicted, name, "Anna", "a trial")
    with predicted.read() as session:
        for table in (Aggregate, SieveResult, PackingTest, MixtureComponent, Calibration, Prediction, Run):
            assert session.scalar(sa.select(sa.func.count()).select_from(table)) == 0
        kept = {(one.table_name, one.row_key): one for one in session.scalars(sa.select(Correction))}
    assert len(kept) == 3 + 3 + 6 + 3
    sieved = json.loads(kept["sieve_analysis", "1"].old_value or "")
    assert sieved["aggregate_id"] == 1
    assert [part["raw_text"] for part in sieved["parts"]] == ["60.96\t100", "40.64\t0"]
