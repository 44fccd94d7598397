"""Geometric references of stored mixtures: no density test, no calibration, few real beds; outdated by new sieves."""

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import shell
import sqlalchemy as sa
from conftest import ThreadsPool

from pdlab import experiments
from pdlab.batch.runner import Repeater, Runner
from pdlab.errors import InputError
from pdlab.experiments import (
    REFERENCES,
    Way,
    calibrate,
    compare,
    comparisons,
    correct,
    predict,
    refresh,
    register,
    sheet,
    show,
    verify,
)  # fmt: skip
from pdlab.geometry import LATTICES, nested
from pdlab.models import Calibration, Prediction, PredictionCalibration, Run
from pdlab.specimen import PLACED, Packing, Protocol, Species, Specimen, equal_spheres, with_seeds
from pdlab.store import Store, open_store
from pdlab.tables import read_path
from pdlab.tree import draw

Folder = Callable[..., Path]
AGGREGATES = "name\ncoarse\nsame\nfine\n"
SIEVES = """\
aggregate,aperture_mm,passing_percent
coarse,16,100
coarse,8,0
same,16,100
same,8,0
fine,8,100
fine,4,0
"""
MIXTURES = """\
mixture,aggregate,solid_volume_share
M,coarse,0.6
M,fine,0.4
E,coarse,0.5
E,same,0.5
"""
MEASURED = "material,compaction,packing_density\nM,loose,0.64\nE,rodded,0.62\n"


@pytest.fixture
def lab(store: Store, folder: Folder) -> Store:
    """Two mixtures of sieved aggregates without a density test: one of two sizes, one of two equal ones."""
    register(store, read_path(folder(aggregates=AGGREGATES, sieves=SIEVES, mixtures=MIXTURES)))
    return store


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, Runner]]:
    """The same mixtures in a file, and the real engine, in threads."""
    folder = tmp_path_factory.mktemp("references")
    for name, text in {"aggregates": AGGREGATES, "sieves": SIEVES, "mixtures": MIXTURES}.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    target = open_store(str(folder / "lab.db"))
    register(target, read_path(folder))
    runner = Runner(target, ThreadsPool(2))
    yield target, runner
    runner.close()
    target.close()


def rows(target: Store, table: Any) -> list[Any]:
    with target.read() as session:
        return list(session.scalars(sa.select(table)))


def states(target: Store) -> dict[tuple[str, str], str]:
    return {(one.mixture, one.method): one.state for one in comparisons(target) if one.state != "open"}


def test_a_mixture_rolls_to_rest_with_no_density_test_and_no_calibration(real: tuple[Store, Runner]) -> None:
    target, runner = real
    blend, equal = predict(target, runner, (), Way("drop_and_roll"))
    assert (blend.state, blend.input_error, blend.rule, blend.volume_mean) == ("done", 0.0, "log_mean", None)
    assert blend.standard_error is not None
    assert 0.0 < blend.standard_error <= 0.003
    assert equal.packing_density == pytest.approx(0.58, abs=0.005)
    assert (blend.packing_density or 0.0) > (equal.packing_density or 1.0) + 0.02
    assert not rows(target, Calibration) + rows(target, PredictionCalibration)
    assert blend.engine_version == runner.engine_version


def test_equal_aggregates_rest_on_the_beds_of_equal_spheres(real: tuple[Store, Runner]) -> None:
    target, runner = real
    (equal,) = predict(target, runner, ["E"], Way("static", seeds=2))
    assert equal.seeds == 2
    beds = with_seeds(equal_spheres(0.7, 1, Protocol("static")), (1, 2))
    with target.read() as session:
        row = session.get(Prediction, equal.prediction_id)
        assert {link.specimen_hash for link in row.runs} == {bed.digest(runner.engine_version) for bed in beds}
        assert {session.get(Run, link.specimen_hash).rest for link in row.runs} == {"placed"}
    assert equal.packing_density == pytest.approx(0.384, abs=0.004)


def test_asked_for_again_it_is_read(real: tuple[Store, Runner]) -> None:
    target, runner = real
    first = predict(target, runner, ["E"], Way("drop_and_roll"))
    simulated = runner.simulated
    again = predict(target, runner, ["E"], Way("drop_and_roll"))
    assert [one.prediction_id for one in again] == [one.prediction_id for one in first]
    assert runner.simulated == simulated


def test_placed_beds_repeat_to_the_bit(opened: Store) -> None:
    kinds = (Species(1.0, 0.0, 60), Species(0.5, 0.0, 480))
    beds = [Specimen(kinds, 5.0, seed, Protocol(method)) for method in PLACED for seed in (1, 2)]
    runner, again = (one(opened, ThreadsPool(2)) for one in (Runner, Repeater))
    runner(beds)
    found = verify(opened, again.repeat, again.engine_version)
    assert [(one.verdict, one.message) for one in found] == [("equal", "")] * 4
    assert {run.rest for run in rows(opened, Run)} == {"placed"}
    runner.close()
    again.close()


class Scattering:
    """An engine by a formula whose beds of odd and even seeds lie apart by twice a distance in PD."""

    def __init__(self, inner: Any, distance: float) -> None:
        self.inner, self.distance, self.engine_version = inner, distance, inner.engine_version

    def __call__(self, specimens: Sequence[Specimen]) -> list[Packing]:
        beds = zip(self.inner(specimens), specimens, strict=True)
        return [replace(bed, packing_density=0.5 + self.distance * (-1) ** one.seed) for bed, one in beds]


@pytest.mark.parametrize(("distance", "seeds"), [(0.001, 4), (0.006, 6), (0.02, 16)])
def test_more_seeds_are_placed_until_the_error_is_met_and_never_more_than_sixteen(
    lab: Store, formula_runner: Any, distance: float, seeds: int
) -> None:
    (report,) = predict(lab, Scattering(formula_runner(lab), distance), ["M"], Way("static"))
    assert report.seeds == seeds
    assert report.standard_error == pytest.approx(distance / (seeds - 1) ** 0.5)


def test_the_ordered_reference_is_a_formula_of_sizes_coarse_to_fine_and_equal_ones_count_as_one(
    lab: Store, formula_runner: Any
) -> None:
    runner = formula_runner(lab)
    blend, equal = predict(lab, runner, (), Way("ordered"))
    assert blend.packing_density == nested([0.6, 0.4])
    assert equal.packing_density == pytest.approx(LATTICES["fcc"])
    assert (blend.standard_error, blend.input_error, blend.engine_version) == (0.0, 0.0, None)
    assert not runner.asked
    assert not rows(lab, Run)


@pytest.mark.parametrize("method", REFERENCES)
def test_a_result_says_that_it_is_a_reference_and_what_was_assumed_of_a_pan(
    lab: Store, folder: Folder, formula_runner: Any, method: str
) -> None:
    sieves = "aggregate,aperture_mm,passing_percent,date\nfine,8,100,2026-01-02\nfine,4,8,2026-01-02\n"
    register(lab, read_path(folder(sieves=sieves)))
    blend, equal = predict(lab, formula_runner(lab), (), Way(method))
    for report in (blend, equal):
        assert report.notes[0].startswith("reference, no prediction of this material: ")
    assert any(note.startswith("fine: ") and "pan" in note for note in blend.notes)
    assert len(equal.notes) == 1
    assert [one.notes for one in comparisons(lab)] == [blend.notes, equal.notes]


@pytest.mark.parametrize("method", REFERENCES)
def test_an_aggregate_sieved_anew_outdates_the_references_of_its_mixtures(
    lab: Store, folder: Folder, formula_runner: Any, method: str
) -> None:
    predict(lab, formula_runner(lab), (), Way(method))
    assert set(states(lab).values()) == {"done"}
    sieves = "aggregate,aperture_mm,passing_percent,date\nsame,4,100,2026-01-02\nsame,2,0,2026-01-02\n"
    register(lab, read_path(folder(sieves=sieves)))
    assert states(lab) == {("M", method): "done", ("E", method): "outdated"}
    report = next(one for one in comparisons(lab) if one.mixture == "E")
    assert report.message.endswith("run 'pdlab predict' again")
    predict(lab, formula_runner(lab), ["E"], Way(method))
    assert set(states(lab).values()) == {"done"}


@pytest.mark.parametrize("method", REFERENCES)
def test_a_corrected_sieve_outdates_a_reference_and_putting_it_back_does_not(
    lab: Store, formula_runner: Any, method: str
) -> None:
    predict(lab, formula_runner(lab), (), Way(method))
    correct(lab, {"sieve_result:2/0": {"aperture_mm": "20"}}, "A")
    assert states(lab) == {("M", method): "done", ("E", method): "outdated"}
    correct(lab, {"sieve_result:2/0": {"aperture_mm": "16"}}, "A")
    assert set(states(lab).values()) == {"done"}
    correct(lab, {"sieve_result:3/0": {"aperture_mm": "9"}}, "A")  # the sizes' order, and ordered's number, stay
    assert states(lab) == {("M", method): "outdated", ("E", method): "done"}


@pytest.mark.parametrize("method", REFERENCES)
def test_corrected_shares_outdate_a_reference(lab: Store, formula_runner: Any, method: str) -> None:
    predict(lab, formula_runner(lab), ["M"], Way(method))
    half = {"solid_volume_share": "0.5"}
    correct(lab, {"mixture_component:1/0": half, "mixture_component:1/1": half}, "A")
    assert states(lab) == {("M", method): "outdated"}


def test_a_density_test_says_nothing_to_a_reference(lab: Store, folder: Folder, formula_runner: Any) -> None:
    for method in REFERENCES:
        predict(lab, formula_runner(lab), ["M"], Way(method))
    tests = "material,compaction,packing_density\ncoarse,loose,0.6\nfine,rodded,0.6\n"
    register(lab, read_path(folder(packing_tests=tests)))
    assert set(states(lab).values()) == {"done"}


def test_references_of_an_older_engine_are_refreshed_by_their_own_rule(lab: Store, formula_runner: Any) -> None:
    old = formula_runner(lab, 2)
    for method in REFERENCES:
        predict(lab, old, ["M"], Way(method, "harmonic"))
    new = formula_runner(lab, 3)
    assert {one.method: one.state for one in comparisons(lab, 3, ["M"])} == {
        "static": "outdated", "drop_and_roll": "outdated", "ordered": "done",
    }  # fmt: skip
    found = refresh(lab, new, 3)
    assert [(one.name, one.error) for one in found] == [("M", None), ("M", None)]
    assert {(one.state, one.rule) for one in comparisons(lab, 3, ["M"])} == {("done", "harmonic")}


def test_an_aggregate_that_was_not_sieved_is_a_named_error_of_its_mixture(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    mixtures = "mixture,aggregate,solid_volume_share\nN,coarse,0.5\nN,bare,0.5\n"
    register(lab, read_path(folder(aggregates="name\nbare\n", mixtures=mixtures)))
    for method in REFERENCES:
        good, bad = predict(lab, formula_runner(lab), ["M", "N"], Way(method))
        assert good.error is None
        assert str(bad.error) == "aggregate 'bare' of mixture 'N' has no sieve analysis; enter one"
    assert {state for (name, _), state in states(lab).items() if name == "N"} == {"failed"}


@pytest.mark.parametrize("method", REFERENCES)
def test_a_reference_calibrates_nothing(lab: Store, formula_runner: Any, method: str) -> None:
    with pytest.raises(InputError, match=r"calibrates nothing; use monosized, monosized_rolling, graded, repose, auto"):
        calibrate(lab, formula_runner(lab), (), Way(method))


def test_the_sheet_of_a_reference_holds_the_diameter_rules_and_the_pans_alone(
    lab: Store, folder: Folder, formula_runner: Any
) -> None:
    sieves = "aggregate,aperture_mm,passing_percent,date\nfine,8,100,2026-01-02\nfine,4,8,2026-01-02\n"
    register(lab, read_path(folder(sieves=sieves)))
    (one,) = sheet(lab, formula_runner(lab), ["M"], Way("drop_and_roll"))
    assert {other.choice for other in one.assumed} == {"diameter rule", "assumed pan size"}
    failed = {other.name: str(other.report.error) for other in one.assumed if other.report.error is not None}
    assert failed.keys() == {"rrsb_d63"}  # which needs a finer table
    assert (one.spread("assumed pan size") or 0.0) > 0.0
    assert len(comparisons(lab, names=["M"])) == 1


def test_show_follows_a_reference_to_its_runs_and_the_sieves_of_its_aggregates(lab: Store, formula_runner: Any) -> None:
    predict(lab, formula_runner(lab), ["M"], Way("static"))
    facts = show(lab, "prediction:1")
    assert len(facts["runs"]) == 4
    sieves = {one["name"]: one["sieve_analyses"][0]["results"] for one in facts["aggregates"]}
    assert [result["aperture_mm"] for result in sieves["fine"]] == [8.0, 4.0]
    assert show(lab, "M")["last_prediction"]["aggregates"] == facts["aggregates"]
    assert show(lab, facts["runs"][0]["address"])["rests_on_it"] == {"prediction": ["1"]}


def test_a_drawn_reference_names_its_rule_and_no_friction(lab: Store, formula_runner: Any) -> None:
    from rich.console import Console

    for method in ("static", "ordered"):
        predict(lab, formula_runner(lab), ["M"], Way(method))
    out = io.StringIO()
    console = Console(width=200, file=out)
    for number in (1, 2):
        console.print(draw(show(lab, f"prediction:{number}")))
    text = out.getvalue()
    assert "method static, diameter rule log_mean, static, engine version 3" in text
    assert "method ordered, diameter rule log_mean, ordered, by a formula, done" in text
    assert "reference, no prediction of this material" in text
    assert "sieve_result:" in text
    assert "μ" not in text


def test_references_stand_in_the_lists_and_the_comparison(lab: Store, folder: Folder, formula_runner: Any) -> None:
    loose = "coarse,loose,0.6\nsame,loose,0.6\nfine,loose,0.6\n"  # and one of the mixtures was rodded
    register(lab, read_path(folder(packing_tests=MEASURED + loose)))
    for method in REFERENCES:
        predict(lab, formula_runner(lab), (), Way(method))
    _, listed = experiments.listed(lab, "predictions", columns=["mixture", "method", "state", "expected_error"])
    reports = {(one.mixture, one.method): one for one in comparisons(lab)}
    assert len(listed) == 2 * len(REFERENCES)
    for mixture, method, state, expected in listed:
        assert (state, expected) == ("done", pytest.approx(reports[mixture, method].expected_error))
    found = compare(lab)
    assert {one.method: one.errors.mixtures for one in found.over_own if one.method in REFERENCES} == dict.fromkeys(
        REFERENCES, 2
    )


def test_the_shell_prints_references_as_such_and_refuses_to_calibrate_by_them(folder: Folder) -> None:
    tables = folder(aggregates=AGGREGATES, sieves=SIEVES, mixtures=MIXTURES, packing_tests=MEASURED)
    pdlab = partial(shell.pdlab, folder=tables)
    assert pdlab("import", ".").returncode == 0
    done = pdlab("predict", "--method", "ordered")
    assert done.returncode == 0, done.stderr
    assert "Reference beside measured packing density (method ordered, diameter rule log_mean)" in done.stdout
    assert "note: M, E: reference, no prediction of this material: sizes of infinite ratio" in done.stdout
    assert "volume mean of the aggregates" not in done.stdout
    refused = pdlab("calibrate", "--method", "ordered")
    assert refused.returncode == 2
    assert "'ordered' is a geometric reference and calibrates nothing; use monosized" in refused.stderr


@pytest.mark.parametrize("method", REFERENCES)
def test_the_list_marks_a_reference_whose_aggregate_was_sieved_anew_or_corrected(
    store: Store, folder: Folder, formula_runner: Any, method: str
) -> None:
    register(store, read_path(folder(aggregates=AGGREGATES, sieves=SIEVES, mixtures=MIXTURES)))
    predict(store, formula_runner(store), (), Way(method))

    def states() -> list[tuple[str, str]]:
        listed = sorted(experiments.listed(store, "predictions", columns=["mixture", "state"])[1])
        assert listed == sorted((one.mixture, one.state) for one in comparisons(store))
        return [(mixture, state) for mixture, state in listed]

    assert states() == [("E", "done"), ("M", "done")]
    sieves = "aggregate,aperture_mm,passing_percent,date\nsame,4,100,2026-01-02\nsame,2,0,2026-01-02\n"
    register(store, read_path(folder(sieves=sieves)))
    assert states() == [("E", "outdated"), ("M", "done")]
    predict(store, formula_runner(store), ["E"], Way(method))
    assert states() == [("E", "done"), ("M", "done")]
    correct(store, {"sieve_result:3/0": {"aperture_mm": "10"}}, "A")
    states()
    correct(store, {"sieve_result:3/0": {"aperture_mm": "8"}}, "A")
    assert states() == [("E", "done"), ("M", "done")]
