"""What theory makes of stored mixtures, alone and beside predictions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pdlab import theory
from pdlab.errors import DensityError, GradingError, InputError, ProtocolError, UnknownName
from pdlab.experiments import by_theory, comparisons, predict, register
from pdlab.experiments.theories import MODELS, Recipe, Theoretical, evaluate
from pdlab.frames import prediction_frame
from pdlab.store import Store
from pdlab.tables import read_path
from pdlab.theory import Material

Folder = Callable[..., Path]
AGGREGATES = "name\nstone\ngravel\nsand\nhard\nunsieved\nuntested\n"
SIEVES = """\
aggregate,aperture_mm,passing_percent
stone,32,100
stone,16,0
gravel,16,100
gravel,8,50
gravel,4,0
sand,4,100
sand,2,60
sand,1,0
hard,8,100
hard,4,0
untested,8,100
untested,4,0
"""
TESTS = """\
material,compaction,packing_density
stone,loose,0.56
gravel,unstated,0.58
sand,rodded,0.6
hard,loose,0.85
unsieved,loose,0.6
stone+gravel,loose,0.64
"""
MIXTURES = """\
mixture,aggregate,solid_volume_share
stone+gravel,stone,0.6
stone+gravel,gravel,0.4
untested blend,stone,0.5
untested blend,gravel,0.5
stone+sand,stone,0.7
stone+sand,sand,0.3
stone+hard,stone,0.5
stone+hard,hard,0.5
stone+unsieved,stone,0.5
stone+unsieved,unsieved,0.5
stone+untested,stone,0.5
stone+untested,untested,0.5
"""
STONE = Material(512**0.5, 0.56, compaction="loose")
GRAVEL = Material((128 * 32) ** 0.25, 0.58, (128**0.5, 32**0.5), (0.5, 0.5), "loose")
SAND = Material(2.0, 0.6, (8**0.5, 2**0.5), (0.4, 0.6), "rodded")


@pytest.fixture
def lab(store: Store, folder: Folder) -> Store:
    register(store, read_path(folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=TESTS, mixtures=MIXTURES)))
    return store


def one(store: Store, mixture: str, **options: Any) -> Theoretical:
    return by_theory(store, [mixture], **options)[0]


def test_ferets_pebbles_through_the_store(pebbles: Store) -> None:
    found = by_theory(pebbles, wanted=tuple(MODELS))
    measured = {"pebbles L+M 1:1": 0.642, "pebbles L+F 1:1": 0.644, "pebbles M+F 1:1": 0.621}
    errors = {name: sum(abs(report.values[name] - measured[report.mixture]) for report in found) / 3 for name in MODELS}
    assert errors == pytest.approx({"toufar": 0.0106, "cpm": 0.0115, "furnas": 0.1085, "volume_mean": 0.0373}, abs=5e-5)


def test_the_theories_get_the_current_diameter_density_test_classes_and_shares(lab: Store) -> None:
    values = one(lab, "stone+gravel").values
    assert values == pytest.approx(
        {name: model([STONE, GRAVEL], [[0.6, 0.4]], "loose")[0] for name, model in theory.THEORIES.items()}, abs=1e-12
    )
    unstated = one(lab, "untested blend").values  # of gravel; it is taken as loose, and so is the mixture
    assert unstated == pytest.approx(
        {name: model([STONE, GRAVEL], [[0.5, 0.5]], "loose")[0] for name, model in theory.THEORIES.items()}, abs=1e-12
    )
    in_one_class = theory.cpm([STONE, Material(GRAVEL.diameter, 0.58, compaction="loose")], [[0.6, 0.4]], "loose")[0]
    assert abs(values["cpm"] - in_one_class) > 1e-4


def test_a_newer_density_test_takes_the_place_of_the_older(lab: Store, folder: Folder) -> None:
    before = one(lab, "stone+gravel").values
    newer = "material,compaction,packing_density,date\nstone,loose,0.58,2026-02-03\n"
    register(lab, read_path(folder(packing_tests=newer) / "packing_tests.csv"))
    after = one(lab, "stone+gravel").values
    assert all(after[name] > before[name] for name in ("toufar", "cpm"))


def test_the_diameter_rule_is_that_of_the_question(lab: Store) -> None:
    usual, harmonic = (one(lab, "stone+gravel", rule=rule).values for rule in ("log_mean", "harmonic"))
    assert harmonic["toufar"] > usual["toufar"]  # the wider grading becomes finer
    assert harmonic["cpm"] == usual["cpm"]


@pytest.mark.parametrize(
    ("mixture", "name", "message"),
    [
        ("stone+unsieved", "toufar", "aggregate 'unsieved' has no sieve analysis; enter one"),
        ("stone+untested", "cpm", "aggregate 'untested' has no density test; enter one"),
        ("stone+sand", "toufar", "toufar knows no compaction and cannot mix loose and rodded"),
        ("stone+sand", "cpm", "the aggregates were tested loose and rodded, and cpm takes the mixture's own"),
        ("stone+hard", "cpm", "packing density 0.85 of the aggregate of 5.65685 mm needs a residual packing density"),
    ],
)
def test_what_cannot_be_worked_out_has_its_sentence(lab: Store, mixture: str, name: str, message: str) -> None:
    report = next(report for report in by_theory(lab) if report.mixture == mixture)
    assert name not in report.values
    assert message in str(report.errors[name])


def test_one_mixtures_error_leaves_the_others_and_the_other_theories_alone(lab: Store) -> None:
    found = {report.mixture: report for report in by_theory(lab)}
    assert found["stone+gravel"].values.keys() == theory.THEORIES.keys()
    assert not found["stone+gravel"].errors
    assert found["stone+hard"].values.keys() == {"furnas", "toufar"}
    assert isinstance(found["stone+hard"].errors["cpm"], DensityError)


def test_a_mixture_tested_rodded_of_aggregates_tested_otherwise_has_a_packing_density_by_cpm_only(
    lab: Store, folder: Folder
) -> None:
    tests = "material,compaction,packing_density\nstone+sand,rodded,0.7\nstone+gravel,rodded,0.68\n"
    loose = one(lab, "stone+gravel").values["cpm"]
    register(lab, read_path(folder(packing_tests=tests) / "packing_tests.csv"))
    mixed, compacted = one(lab, "stone+sand"), one(lab, "stone+gravel")
    assert mixed.values == pytest.approx({"cpm": theory.cpm([STONE, SAND], [[0.7, 0.3]], "rodded")[0]}, abs=1e-12)
    assert compacted.values.keys() == {"cpm"}
    assert compacted.values["cpm"] > loose
    assert isinstance(compacted.errors["toufar"], ProtocolError)


def test_many_mixtures_at_once_are_the_same_as_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdlab.experiments.theories.BLOCK", 3)
    fine = Material(0.2, 0.6, compaction="rodded")
    asked = [
        Recipe(str(k), materials, shares, way)
        for k, (materials, shares, way) in enumerate(
            [
                ((STONE, GRAVEL), (0.6, 0.4), "loose"),
                ((GRAVEL, STONE), (0.2, 0.8), "rodded"),
                ((STONE, SAND), (0.5, 0.5), "rodded"),
                ((SAND, fine), (0.7, 0.3), "rodded"),
                ((STONE, GRAVEL, STONE), (0.2, 0.5, 0.3), "loose"),
                ((GRAVEL,), (0.999,), "loose"),
                ((STONE, SAND, fine), (0.4, 0.3, 0.3), "vibrated"),
                ((STONE, GRAVEL), (0.1, 0.9), "loose"),
            ]
        )
    ]
    together = evaluate(asked, tuple(MODELS))
    for recipe, report in zip(asked, together, strict=True):
        (alone,) = evaluate([recipe], tuple(MODELS))
        assert report.mixture == recipe.mixture
        assert report.values == pytest.approx(alone.values, abs=1e-12)
        assert {name: str(error) for name, error in report.errors.items()} == {
            name: str(error) for name, error in alone.errors.items()
        }
    (in_one_heap,) = evaluate([Recipe("", (STONE, GRAVEL), (0.5, 0.5), "loose")], tuple(MODELS))
    assert together[4].values == pytest.approx(in_one_heap.values, abs=1e-12)
    assert sum(len(report.errors) for report in together) == 9


def test_theories_that_are_absent_or_unknown_are_refused_by_name(lab: Store) -> None:
    with pytest.raises(InputError, match="the theory 'dewar' is absent"):
        by_theory(lab, wanted=("dewar",))
    with pytest.raises(InputError, match="'magic' is no theory"):
        by_theory(lab, wanted=("magic",))
    with pytest.raises(UnknownName):
        by_theory(lab, ["nothing"])
    with pytest.raises(GradingError, match="'mean' is no diameter rule"):
        by_theory(lab, rule="mean")


def test_theory_stands_beside_every_prediction_also_a_failed_one(lab: Store, formula_runner: Any) -> None:
    predicted = {report.mixture: report for report in predict(lab, formula_runner(lab))}
    done, failed = predicted["stone+gravel"], predicted["stone+hard"]
    values = one(lab, "stone+gravel").values
    assert (done.state, failed.state) == ("done", "failed")
    assert {name: getattr(done, name) for name in values} == pytest.approx(values, abs=1e-12)
    assert done.theory_message == ""
    assert failed.toufar is not None
    assert failed.cpm is None
    assert failed.theory_message.startswith("no cpm: packing density 0.85 of the aggregate")
    unsieved = predicted["stone+unsieved"].theory_message
    assert unsieved == "no furnas, toufar, cpm: aggregate 'unsieved' has no sieve analysis; enter one"
    for report in comparisons(lab):
        wanted = predicted[report.mixture]
        assert (report.toufar, report.cpm, report.theory_message) == (wanted.toufar, wanted.cpm, wanted.theory_message)


def test_the_table_of_predictions_has_theory_columns_and_says_what_is_missing(lab: Store, formula_runner: Any) -> None:
    frame = prediction_frame(predict(lab, formula_runner(lab), ["stone+gravel", "stone+hard"]))
    columns = "mixture,method,packing_density,standard_error,input_error,expected_error,measured,difference,toufar,cpm,"
    assert frame.to_csv(index=False).splitlines()[0] == columns + "state,message"
    assert frame["toufar"].notna().all()
    assert list(frame["cpm"].notna()) == [True, False]
    assert "no cpm: packing density 0.85" in frame["message"][1]
