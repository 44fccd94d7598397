"""The services: register all or nothing, calibrate, predict, compare."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import func, select

from pdlab import experiments
from pdlab import store as store_module
from pdlab.errors import (
    EngineError,
    InputError,
    NotAtRest,
    OutOfReach,
    ProtocolError,
    ShareError,
    SpecimenTooLarge,
    TableError,
    TooSoft,
    UnknownName,
)
from pdlab.experiments import Way, calibrate, comparisons, predict, register
from pdlab.lab import SHIPPED
from pdlab.models import Aggregate, Calibration, Prediction, Run
from pdlab.specimen import Packing, Specimen
from pdlab.store import Store
from pdlab.tables import read_path

Folder = Callable[..., Path]
AGGREGATES = "name,particle_density_kg_m3,density_basis,water_absorption_percent\nA,2600,oven_dry,\nB,2639,ssd,1.5\n"
SIEVES = "aggregate,aperture_mm,retained_g\nA,32,0\nA,16,100\nB,8,0\nB,4,100\n"
TESTS = """\
material,compaction,bulk_density_kg_m3,repeats,standard_deviation
A,loose,1560,4,20
B,loose,1508,4,20
M,loose,1690,,
"""
MIXTURES = "mixture,aggregate,mass_share\nM,A,0.5\nM,B,0.5\n"


def count(store: Store, table: Any) -> int:
    with store.read() as session:
        return session.scalar(select(func.count()).select_from(table)) or 0


def load(store: Store, path: Path) -> experiments.Registered:
    return register(store, read_path(path))


def test_an_import_is_kept_whole_and_an_equal_one_changes_nothing(store: Store) -> None:
    done = load(store, SHIPPED)
    made = {table: number for table, number in done.new.items() if number}
    assert made == {"aggregates": 3, "sieve analyses": 3, "density tests": 6, "mixtures": 3}
    again = load(store, SHIPPED)
    assert not any(again.new.values())
    assert again.equal == 15


def test_raw_text_is_kept_beside_the_number(store: Store, folder: Folder) -> None:
    load(store, folder(aggregates="name\nA\n", sieves="aggregate;aperture_mm;retained_g\nA;31,5;0\nA;16 mm;1240,5\n"))
    with store.read() as session:
        row = store_module.aggregates(session, ["A"])[0]
        results = row.sieve_analyses[0].results
    assert [(result.aperture_mm, result.retained_g) for result in results] == [(31.5, 0.0), (16.0, 1240.5)]
    assert [result.raw_text for result in results] == ["31,5\t0", "16 mm\t1240,5"]


def test_any_problem_leaves_the_store_as_it_was_and_all_are_listed(store: Store, folder: Folder) -> None:
    path = folder(
        aggregates=AGGREGATES,
        sieves=SIEVES + "C,8,0\nC,4,100\n",
        packing_tests=TESTS + "D,loose,1500,,\nA,loose,2700,,\n",
        mixtures=MIXTURES + "N,A,0.5\nN,E,0.5\n",
    )
    with pytest.raises(TableError) as caught:
        load(store, path)
    found = [str(problem) for problem in caught.value.problems]
    assert found == [
        "sieves.csv, row 6, column aggregate: no aggregate named 'C'; add it to aggregates.csv or correct the name",
        "packing_tests.csv, row 5, column material: no aggregate or mixture named 'D'; add it or correct the name",
        "packing_tests.csv, row 6, column bulk_density_kg_m3: bulk_density_kg_m3 2700 gives a packing density of "
        "1.038, outside (0, 1); check the value and its unit",
        "mixtures.csv, row 4, column aggregate: no aggregate named 'E'; add it to aggregates.csv or correct the name",
    ]
    assert count(store, Aggregate) == 0


def test_a_problem_in_one_table_hides_none_in_another(store: Store, folder: Folder) -> None:
    path = folder(aggregates="name\nA\n", sieves="aggregate,aperture_mm,retained_g\nZ,x,0\n", mixtures=MIXTURES)
    with pytest.raises(TableError) as caught:
        load(store, path)
    found = [problem.file for problem in caught.value.problems]
    assert found == ["sieves.csv", "mixtures.csv"]


def test_an_aggregate_with_other_values_needs_a_delivery(store: Store, folder: Folder) -> None:
    load(store, folder(aggregates=AGGREGATES))
    with pytest.raises(
        TableError, match=r"is there with particle_density_kg_m3 2600\.0, not 2700\.0; give a new delivery"
    ):
        load(store, folder(aggregates=AGGREGATES.replace("2600", "2700")))
    load(store, folder(aggregates="name,delivery,particle_density_kg_m3,density_basis\nA,May,2700,oven_dry\n"))
    with store.read() as session:
        assert [row.delivery for row in store_module.aggregates(session)] == ["", "May"]


def test_a_repeated_test_is_a_new_row_and_the_newest_counts(store: Store, folder: Folder) -> None:
    load(store, folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=TESTS, mixtures=MIXTURES))
    load(store, folder(packing_tests="material,compaction,voids_percent,date\nA,loose,39,2026-05-01\n"))
    with store.read() as session:
        row = store_module.aggregates(session, ["A"])[0]
    assert len(row.packing_tests) == 2
    measured = experiments.measured_aggregate(row)
    assert measured is not None
    assert measured.packing_density == pytest.approx(0.61)


def test_mass_shares_are_converted_and_kept(store: Store, folder: Folder) -> None:
    load(
        store,
        folder(
            aggregates="name,particle_density_kg_m3,density_basis\nA,2000,oven_dry\nB,4000,oven_dry\n",
            mixtures=MIXTURES,
        ),
    )
    with store.read() as session:
        parts = store_module.mixtures(session, ["M"])[0].components
    assert [part.solid_volume_share for part in parts] == pytest.approx([2 / 3, 1 / 3])
    assert [part.mass_share for part in parts] == [0.5, 0.5]


def test_mass_shares_without_densities_are_refused(store: Store, folder: Folder) -> None:
    with pytest.raises(TableError, match="needs a particle density of each aggregate"):
        load(store, folder(aggregates="name\nA\nB\n", mixtures=MIXTURES))


def test_a_chain_from_tables_to_a_prediction(store: Store, folder: Folder, formula_runner: Any) -> None:
    load(store, folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=TESTS, mixtures=MIXTURES))
    report = predict(store, formula_runner(store), ["M"])[0]
    assert report.error is None
    assert report.measured == pytest.approx(1690.0 / 2600.0, rel=1e-3)
    assert report.packing_density is not None
    assert report.difference == pytest.approx(report.packing_density - report.measured)
    assert report.standard_error is not None
    assert 0.0 < report.standard_error < 0.004
    assert report.volume_mean == pytest.approx((1560 / 2600 + 1508 / 2600) / 2.0, rel=1e-3)


def test_equal_specimens_are_asked_for_once(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)
    predict(pebbles, runner)
    assert len(runner.asked) == len(set(runner.asked))


def test_calibrating_and_predicting_again_adds_no_row(pebbles: Store, formula_runner: Any) -> None:
    first = predict(pebbles, formula_runner(pebbles))
    rows = count(pebbles, Calibration), count(pebbles, Prediction)
    assert predict(pebbles, formula_runner(pebbles)) == first
    assert (count(pebbles, Calibration), count(pebbles, Prediction)) == rows == (3, 3)


def test_a_result_names_the_runs_and_calibrations_it_rests_on(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)
    predict(pebbles, runner)
    with pebbles.read() as session:
        rows = store_module.predictions(session)
        fits = store_module.calibrations(session)
    used = {run.specimen_hash for row in rows for run in row.runs} | {
        run.specimen_hash for fit in fits for run in fit.runs
    }
    assert used == set(runner.asked)
    assert all(len(row.calibrations) == 2 for row in rows)


def test_unstated_compaction_and_deviation_are_said(pebbles: Store, formula_runner: Any) -> None:
    report = calibrate(pebbles, formula_runner(pebbles), ["pebbles L"])[0]
    assert report.result is not None
    assert "the density test's compaction is not stated: it is simulated as loose" in report.result.warnings
    assert any("standard error of 0.005" in text for text in report.result.warnings)


@pytest.mark.parametrize(("name", "call"), [("gravel", calibrate), ("blend", predict)])
def test_an_unknown_name_is_refused_with_the_known_ones(
    pebbles: Store, formula_runner: Any, name: str, call: Any
) -> None:
    with pytest.raises(UnknownName, match=rf"named '{name}' \(it holds: pebbles"):
        call(pebbles, formula_runner(pebbles), [name])


def test_an_empty_store_says_what_to_do_first(store: Store, formula_runner: Any) -> None:
    for call in (calibrate, predict):
        with pytest.raises(InputError, match="run 'pdlab demo'"):
            call(store, formula_runner(store))


@pytest.mark.parametrize(
    ("tests", "error", "message"),
    [
        ("material,compaction,packing_density\nA,loose,0.47\n", OutOfReach, "packing density 0.47 is out of reach"),
        ("material,compaction,packing_density\nA,loose,0.7\n", OutOfReach, "packing density 0.7 is out of reach"),
        ("material,compaction,packing_density\nB,loose,0.6\n", InputError, "'A' has no density test"),
    ],
)
def test_an_aggregate_that_cannot_be_calibrated_says_why_and_stops_no_other(
    store: Store, folder: Folder, formula_runner: Any, tests: str, error: type[Exception], message: str
) -> None:
    load(store, folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=tests + "B,loose,0.59\n", mixtures=MIXTURES))
    bad, good = calibrate(store, formula_runner(store))
    assert isinstance(bad.error, error)
    assert message in str(bad.error)
    assert good.result is not None
    report = predict(store, formula_runner(store))[0]
    assert isinstance(report.error, error)
    assert report.state == "failed"
    assert "aggregate 'A' of mixture 'M' is not calibrated" in report.message
    summary = experiments.summaries(store)[0]
    assert summary.friction is None
    assert (message in summary.message) == isinstance(bad.error, OutOfReach)  # known before a test was simulated
    assert comparisons(store)[0].state == "failed"
    assert message in comparisons(store)[0].message


def test_a_test_is_simulated_as_it_was_compacted(store: Store, folder: Folder, formula_runner: Any) -> None:
    rodded = TESTS.replace("loose", "rodded")
    load(store, folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=rodded, mixtures=MIXTURES))
    (report,) = predict(store, formula_runner(store))
    assert report.state == "done"
    with store.read() as session:
        rows = [*session.scalars(select(Calibration)), *session.scalars(select(Prediction))]
        ways = {json.loads(run.specimen)["protocol"]["compaction"] for run in session.scalars(select(Run))}
    assert {json.loads(row.protocol)["compaction"] for row in rows} == ways == {"rodded"}


def test_loose_and_rodded_tests_do_not_mix(store: Store, folder: Folder, formula_runner: Any) -> None:
    tests = TESTS.replace("B,loose", "B,rodded")
    load(store, folder(aggregates=AGGREGATES, sieves=SIEVES, packing_tests=tests, mixtures=MIXTURES))
    (report,) = predict(store, formula_runner(store))
    assert isinstance(report.error, ProtocolError)
    assert "newest density tests are loose and rodded" in str(report.error)


def test_a_failed_run_fails_its_mixture_and_no_other(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)

    def run_all(specimens: Any) -> Any:
        out = runner(specimens)
        broken = [bed.species[-1].diameter < 0.3 for bed in specimens]  # only the mixture of L and F
        return [NotAtRest("it moves") if bad else packing for bad, packing in zip(broken, out, strict=True)]

    run_all.engine_version = runner.engine_version  # type: ignore[attr-defined]
    states = {report.mixture: report.state for report in predict(pebbles, run_all)}
    assert states == {"pebbles L+M 1:1": "done", "pebbles L+F 1:1": "failed", "pebbles M+F 1:1": "done"}


def test_contacts_that_are_too_soft_are_stiffened_and_that_is_said(pebbles: Store, formula_runner: Any) -> None:
    runner, asked = formula_runner(pebbles), dict[float, int]()

    def soft(specimens: Sequence[Specimen]) -> list[Packing | EngineError]:
        out: list[Packing | EngineError] = []
        for specimen in specimens:
            overlap = specimen.protocol.nominal_overlap
            asked[overlap] = asked.get(overlap, 0) + 1
            mixed = len(specimen.species) > 1
            out += [TooSoft("overlap")] if mixed and overlap > limit and specimen.seed != 2 else runner([specimen])
        return out

    soft.engine_version = runner.engine_version  # type: ignore[attr-defined]
    limit = 0.0006
    reports = predict(pebbles, soft)
    assert {report.state for report in reports} == {"done"}
    assert all("contacts are 4 times as stiff" in (report.message or "") for report in reports)
    assert sorted(asked) == [0.0005, 0.001, 0.002]
    with pebbles.read() as session:
        rows = list(session.scalars(select(Prediction)))
        beds = {run.specimen_hash: json.loads(run.specimen)["protocol"] for run in session.scalars(select(Run))}
        rested_on = {beds[link.specimen_hash]["nominal_overlap"] for row in rows for link in row.runs}
    assert rested_on == {0.0005}  # none of the softer beds that passed
    assert {json.loads(row.protocol)["nominal_overlap"] for row in rows} == {0.0005}
    limit = 0.0001
    failed = predict(pebbles, soft, way=Way(seeds=5))  # what is kept has four
    assert all(isinstance(report.error, TooSoft) for report in failed)
    assert min(asked) == 0.00025


def test_a_mixture_too_far_apart_says_how_many_spheres_it_takes(
    store: Store, folder: Folder, formula_runner: Any
) -> None:
    sieves = "aggregate,aperture_mm,retained_g\nA,64,0\nA,32,100\nB,1,0\nB,0.5,100\n"
    load(store, folder(aggregates=AGGREGATES, sieves=sieves, packing_tests=TESTS, mixtures=MIXTURES))
    report = predict(store, formula_runner(store))[0]
    assert isinstance(report.error, SpecimenTooLarge)
    assert not isinstance(report.error, ShareError)


def test_the_expected_error_holds_the_other_comparisons(pebbles: Store, formula_runner: Any) -> None:
    predict(pebbles, formula_runner(pebbles))
    reports = comparisons(pebbles)
    first, *others = reports
    rms = (sum((other.difference or 0.0) ** 2 for other in others) / 2.0) ** 0.5
    own = ((first.standard_error or 0.0) ** 2 + (first.input_error or 0.0) ** 2 + rms**2) ** 0.5
    assert first.expected_error == pytest.approx(own)


def test_a_friction_asked_for_alone_is_the_one_found_beside_others(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)
    together = {report.aggregate: report for report in calibrate(pebbles, runner)}
    for name, report in together.items():
        alone = calibrate(pebbles, runner, [name])[0]
        assert alone.result == report.result
        assert alone.calibration_id == report.calibration_id


def test_the_rule_last_asked_for_is_the_one_reported(pebbles: Store, formula_runner: Any) -> None:
    runner = formula_runner(pebbles)
    for rule in ("log_mean", "arithmetic", "log_mean"):
        assert {report.rule for report in predict(pebbles, runner, (), Way(rule=rule))} == {rule}
    assert count(pebbles, Prediction) == 6


def test_what_names_an_unknown_delivery_is_refused_not_dropped(store: Store, folder: Folder) -> None:
    path = folder(
        aggregates="name,delivery\nA,2026-1\n",
        sieves="aggregate,delivery,aperture_mm,retained_g\nA,2026-I,16,0\nA,2026-I,8,1\n",
        packing_tests="material,delivery,compaction,voids_percent\nmixture:A,,loose,40\nA,x,loose,40\n",
    )
    with pytest.raises(TableError) as caught:
        load(store, path)
    assert [str(problem) for problem in caught.value.problems] == [
        "sieves.csv, row 2, column delivery: no delivery '2026-I' of aggregate 'A' (it has: '2026-1'); "
        "name one in the column delivery",
        "packing_tests.csv, row 2, column material: no mixture named 'A'; add it or correct the name",
        "packing_tests.csv, row 3, column delivery: no delivery 'x' of aggregate 'A' (it has: '2026-1'); "
        "name one in the column delivery",
    ]


def test_an_empty_delivery_is_the_first_and_importing_it_again_changes_no_other(store: Store, tmp_path: Path) -> None:
    def folder(name: str, delivery: str, voids: int) -> Path:
        path = tmp_path / name
        path.mkdir()
        (path / "aggregates.csv").write_text(f"name,delivery\nA,{delivery}\n")
        (path / "sieves.csv").write_text(
            f"aggregate,delivery,aperture_mm,retained_g\nA,{delivery},16,0\nA,{delivery},8,1\n"
        )
        (path / "packing_tests.csv").write_text(
            f"material,delivery,compaction,voids_percent\nA,{delivery},loose,{voids}\n"
        )
        return path

    first, second = folder("first", "", 40), folder("second", "2", 39)
    load(store, first)
    load(store, second)
    assert not any(load(store, first).new.values())
    with store.read() as session:
        row = store_module.aggregates(session, ["A"])[0]
    assert row.delivery == "2"
    assert [test.voids_percent for test in row.packing_tests] == [39.0]


def test_a_mixture_keeps_its_deliveries_and_is_predicted_from_them(
    store: Store, folder: Folder, formula_runner: Any
) -> None:
    tables = {"aggregates": AGGREGATES, "sieves": SIEVES, "packing_tests": TESTS, "mixtures": MIXTURES}
    load(store, folder(**tables))
    before = predict(store, formula_runner(store))[0]
    (folder() / "mixtures.csv").unlink()
    may = folder(
        aggregates="name,delivery\nA,May\n",
        sieves="aggregate,delivery,aperture_mm,retained_g\nA,May,4,0\nA,May,2,1\n",
        packing_tests="material,delivery,compaction,voids_percent\nA,May,loose,42\n",
    )
    load(store, may)
    load(store, folder(**tables))
    assert predict(store, formula_runner(store))[0] == before


def test_a_prediction_on_tests_since_repeated_is_marked(pebbles: Store, folder: Folder, formula_runner: Any) -> None:
    predict(pebbles, formula_runner(pebbles))
    load(pebbles, folder(packing_tests="material,compaction,voids_percent\npebbles L,loose,40.5\n"))
    states = {report.mixture: report.state for report in comparisons(pebbles)}
    assert states == {"pebbles L+M 1:1": "outdated", "pebbles L+F 1:1": "outdated", "pebbles M+F 1:1": "done"}
    assert "pebbles L: tested or sieved anew since" in comparisons(pebbles)[0].message
    assert {report.state for report in predict(pebbles, formula_runner(pebbles))} == {"done"}


def test_bad_mass_shares_and_one_delivery_twice_are_named(store: Store, folder: Folder) -> None:
    mixtures = "mixture,aggregate,delivery,mass_share\nM,A,,0.5\nM,B,,-0.5\nN,A,,0.5\nN,A,1,0.5\n"
    densities = "particle_density_kg_m3,density_basis\nA,1,2000,oven_dry\nB,,2000,oven_dry\n"
    with pytest.raises(TableError) as caught:
        load(store, folder(aggregates=f"name,delivery,{densities}", mixtures=mixtures))
    text = str(caught.value)
    assert "share -0.5 lies outside (0, 1]" in text
    assert "mixture 'N' names one delivery of an aggregate twice" in text


def test_what_was_empty_is_filled_and_nothing_is_overwritten(store: Store, folder: Folder) -> None:
    load(store, folder(aggregates="name,shape\nA,round\n"))
    done = load(store, folder(aggregates="name,particle_density_kg_m3,density_basis\nA,2600,oven_dry\n"))
    assert done.new["aggregates completed"] == 1
    with store.read() as session:
        row = store_module.aggregates(session, ["A"])[0]
    assert (row.shape, row.particle_density_kg_m3) == ("round", 2600.0)
    with pytest.raises(TableError, match="is there with shape round, not angular"):
        load(store, folder(aggregates="name,shape,source\nA,angular,quarry\n"))
    with store.read() as session:
        assert store_module.aggregates(session, ["A"])[0].source is None
