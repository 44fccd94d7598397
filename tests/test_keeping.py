"""What the lists say of aggregates and predictions: what the services compute, and what every write leaves right."""

import datetime as dt
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from conftest import check_kept, rows_of

from pdlab import experiments
from pdlab import store as store_module
from pdlab.calibration import METHOD
from pdlab.errors import NotAtRest
from pdlab.experiments import comparisons, listed, register, summaries
from pdlab.models import (
    Aggregate,
    Calibration,
    Mixture,
    PackingTest,
    Prediction,
    Run,
    SieveAnalysis,
    SieveResult,
    now,
)
from pdlab.store import Store, keeping
from pdlab.tables import read_path

TABLES = {
    "aggregates": "name,delivery,particle_density_kg_m3,density_basis,water_absorption_percent\n"
    "A,,2650,ssd,1.5\nB,,2720,apparent,0.8\nC,,2600,oven_dry,\nA,May,2655,ssd,1.4\n",
    "sieves": "aggregate,delivery,aperture_mm,passing_percent\n"
    "A,,32,100\nA,,16,0\nB,,16,100\nB,,8,0\nC,,8,100\nC,,4,0\n",
    "packing_tests": "material,delivery,compaction,bulk_density_kg_m3,voids_percent,packing_density\n"
    "A,,loose,1560,,\nB,,loose,1600,,\nC,,loose,,41,\nA+B,,loose,1750,,\nA+C,,loose,,36,\nB+C,,loose,,,0.63\n",
    "mixtures": "mixture,aggregate,delivery,solid_volume_share\nA+B,A,,0.6\nA+B,B,,0.4\nA+C,A,,0.7\nA+C,C,,0.3\n"
    "B+C,B,,0.5\nB+C,C,,0.5\nA+B+C,A,,0.2\nA+B+C,B,,0.3\nA+B+C,C,,0.5\n",
}  # fmt: skip


@pytest.fixture
def compared(pebbles: Store, folder: Callable[..., Path], formula_runner: Any) -> Store:
    """Predictions beside tests of each kind on each basis; one outdated, one failed, one mixture never predicted."""
    register(pebbles, read_path(folder(**TABLES)))
    experiments.predict(pebbles, formula_runner(pebbles))
    register(pebbles, read_path(folder(aggregates="name\nD\n", **{
        "sieves": "aggregate,aperture_mm,passing_percent\nD,16,100\nD,8,0\n",
        "packing_tests": "material,compaction,voids_percent,date\nC,loose,40,2026-05-01\nA+C,loose,35,2026-05-01\n",
        "mixtures": "mixture,aggregate,solid_volume_share\nnew,D,0.5\nnew,B,0.5\n",
    })))  # fmt: skip
    with pebbles.write() as session:
        row = session.scalars(sa.select(Mixture).where(Mixture.name == "pebbles L+M 1:1")).one()
        failed = {"state": "failed", "message": "a bed did not come to rest", "requested_at": now()}
        session.add(Prediction(mixture_id=row.id, method=METHOD, protocol="{}", **failed))
    return pebbles


def test_what_is_kept_for_the_lists_follows_every_write(
    compared: Store, formula_runner: Any, folder: Callable[..., Path]
) -> None:
    run_all = formula_runner(compared)
    with compared.read() as session:
        sieved = session.scalars(sa.select(SieveAnalysis.id).join(Aggregate).where(Aggregate.name == "A")).one()
        tested = list(session.scalars(sa.select(PackingTest.id).join(Mixture).where(Mixture.name == "A+C")))
    writes: list[Callable[[], Any]] = [
        lambda: None,
        lambda: experiments.correct(compared, {"aggregate:B": {"particle_density_kg_m3": "2700"}}, "A"),
        lambda: experiments.correct(compared, shares("A+B", 0.5, 0.5), "A"),
        lambda: experiments.correct(compared, {"mixture:A+B": {"name": "B+A"}}, "A"),
        lambda: experiments.correct(compared, {f"sieve_result:{sieved}/1": {"aperture_mm": "14"}}, "A"),
        lambda: experiments.correct(compared, {f"packing_test:{tested[-1]}": {"voids_percent": "34"}}, "A"),
        lambda: experiments.predict(compared, run_all, ["B+A", "A+C"]),
        lambda: experiments.delete(compared, f"packing_test:{tested[-1]}", "A"),
        lambda: experiments.predict(compared, run_all, ["A+B+C"], experiments.Way(rule="harmonic")),
        lambda: experiments.delete(compared, f"prediction:{last('A+B+C')}", "A"),
        lambda: bring("packing_tests", "material,compaction,voids_percent\nB+A,loose,33\nB,loose,39\n"),
        lambda: bring("sieves", "aggregate,aperture_mm,passing_percent\nC,8,100\nC,5,0\n"),
        lambda: experiments.correct(compared, {f"sieve_result:{sieved}/1": {"aperture_mm": "13"}}, "A"),
        lambda: experiments.delete(compared, f"packing_test:{tested[0]}", "A"),
    ]

    def bring(table: str, text: str) -> None:
        register(compared, read_path(folder(**{table: text}) / f"{table}.csv"))

    def last(name: str) -> int | None:
        return comparisons(compared, names=[name])[0].prediction_id

    def shares(name: str, *values: float) -> dict[str, dict[str, str]]:
        with compared.read() as session:
            (key,) = session.scalars(sa.select(Mixture.id).where(Mixture.name == name))
        return {f"mixture_component:{key}/{k}": {"solid_volume_share": str(v)} for k, v in enumerate(values)}

    seen, states = [], list[str]()
    for write in writes:
        write()
        check_kept(compared)
        states.append(experiments.parity_state(compared))
        assert experiments.parity_state(compared) == states[-1], "nothing was written"
        seen.append(rows_of(compared, "predictions", [], ["mixture", "packing_density", "measured", "message"]))
    assert [before != after for before, after in itertools.pairwise(seen)] == [True] * (len(writes) - 1)
    assert len(set(states)) == len(writes)


def test_what_no_list_of_predictions_says_leaves_its_state(compared: Store) -> None:
    before = experiments.parity_state(compared)
    experiments.delete_draft(compared, experiments.save_draft(compared, "aggregate", {}))
    rest = {"specimen": "{}", "seed": 1, "spheres": 9, "state": "failed", "steps": 1, "seconds": 1.0}
    with compared.write() as session:
        session.add(Run(specimen_hash="0" * 64, engine_version=1, **rest))
    assert experiments.parity_state(compared) == before
    with compared.write() as session:
        session.add(Run(specimen_hash="1" * 64, engine_version=99, **rest))
    assert experiments.parity_state(compared) != before, "a newer engine outdates what is there"


def test_what_is_wished_for_is_part_of_the_state_of_the_lists(compared: Store) -> None:
    (key,) = {found for found, name in experiments.mixture_names(compared, 9).items() if name == "A+C"}
    states = [experiments.parity_state(compared)]
    assert experiments.ask_prediction(compared, key, "graded") == ""
    states.append(experiments.parity_state(compared))
    with compared.write() as session:
        (wish,) = store_module.claim_wishes(session, "runner", 1, lambda name: False)
    states.append(experiments.parity_state(compared))
    experiments.cancel(compared, [wish])
    assert len(set(states)) == 3, "none, queued, running"
    assert experiments.parity_state(compared) not in states[1:]


def test_the_sizes_of_a_sieve_analysis_follow_its_results_alone(compared: Store) -> None:
    with compared.write() as session:
        result = session.scalars(sa.select(SieveResult).where(SieveResult.aperture_mm == 60.96)).one()
        result.aperture_mm = 50.0
    check_kept(compared)
    rows = rows_of(compared, "aggregates", ["aggregate=pebbles L"], ["finest_mm", "coarsest_mm", "diameter_mm"])
    assert rows == [(40.64, 50.0, pytest.approx((40.64 * 50.0) ** 0.5))]


def test_a_mixture_more_has_none_of_the_others_compared_anew(
    compared: Store, folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    anew: list[int] = []
    compare = keeping.compare
    monkeypatch.setattr(keeping, "compare", lambda session, ids: (anew.extend(ids), compare(session, ids)))
    text = "mixture,aggregate,solid_volume_share\nB+A 1:9,A,0.1\nB+A 1:9,B,0.9\n"
    register(compared, read_path(folder(mixtures=text) / "mixtures.csv"))
    with compared.read() as session:
        assert anew == list(session.scalars(sa.select(Mixture.id).where(Mixture.name == "B+A 1:9")))
    check_kept(compared)


def test_what_is_kept_for_the_lists_follows_statements_too(compared: Store) -> None:
    before = experiments.parity_state(compared)
    with compared.write() as session:
        session.execute(sa.update(PackingTest).where(PackingTest.mixture_id == 1).values(voids_percent=30.0))
    check_kept(compared)
    assert rows_of(compared, "predictions", ["mixture=pebbles L+M 1:1"], ["measured"]) == [(pytest.approx(0.7),)]
    assert experiments.parity_state(compared) != before


def test_a_write_that_is_undone_leaves_what_is_kept_for_the_lists(compared: Store, folder: Callable[..., Path]) -> None:
    before = rows_of(compared, "predictions", [], ["mixture", "measured"])
    text = "material,compaction,voids_percent,date\nA+C,loose,30,2026-06-01\n"
    register(compared, read_path(folder(packing_tests=text) / "packing_tests.csv"), dry_run=True)

    def fail() -> None:
        with compared.write() as session:
            session.add(Prediction(mixture_id=1, method="graded", protocol="{}", state="done", packing_density=0.7))
            session.flush()
            raise RuntimeError

    state = experiments.parity_state(compared)
    with pytest.raises(RuntimeError):
        fail()
    check_kept(compared)
    assert experiments.parity_state(compared) == state
    assert rows_of(compared, "predictions", [], ["mixture", "measured"]) == before


def test_the_list_of_predictions_says_what_the_services_compute(compared: Store) -> None:
    names, rows = listed(compared, "predictions", [], ["engine_version", *store_module.SHOWN["predictions"]], "", None)
    reports = comparisons(compared)
    assert {report.state for report in reports} == {"done", "outdated", "failed", "open"}
    assert sum(report.difference is not None for report in reports) == 5
    assert len(rows) == len(reports)
    for row, report in zip(rows, reports, strict=True):
        said = dict(zip(names, row, strict=True))
        if report.state == "open":
            assert said.pop("method") is None
        for name, value in said.items():
            wanted = getattr(report, name)
            assert value == (pytest.approx(wanted, abs=1e-12) if isinstance(wanted, float) else wanted), name


def test_a_mixture_has_a_row_for_the_newest_prediction_of_each_method_and_none_for_variants(compared: Store) -> None:
    kept = {"mixture_id": 1, "protocol": "{}", "state": "done"}
    rows = [("graded", "", 0.61), ("graded", "", 0.62), ("static", "", 0.5), ("graded", "local_damping=0", 0.7),
            ("ordered", "local_damping=0", 0.74)]  # fmt: skip
    with compared.write() as session:
        for k, (method, variant, value) in enumerate(rows):
            when = now() + dt.timedelta(seconds=k)
            session.add(Prediction(method=method, variant=variant, packing_density=value, requested_at=when, **kept))
            session.flush()
        session.add(Prediction(method="graded", packing_density=0.9, mixture_id=1, protocol="{}"))  # it waits
    names = ["mixture", "method", "packing_density", "message"]
    seen = [row for row in rows_of(compared, "predictions", [], names) if row[0] == "pebbles L+M 1:1"]
    assert [row[:3] for row in seen[1:]] == [("pebbles L+M 1:1", "graded", 0.62), ("pebbles L+M 1:1", "static", 0.5)]
    assert seen[0][1] == METHOD
    assert listed(compared, "predictions", [], names, "", 3)[1] == seen
    reports = comparisons(compared, names=["pebbles L+M 1:1"])
    assert [(report.mixture, report.method, report.packing_density) for report in reports] == [row[:3] for row in seen]
    with compared.read() as session:
        last = store_module.last_prediction(session, 1)
        assert last is not None
        assert (last.method, last.variant) == ("static", "")


@pytest.mark.parametrize("compaction", ["loose", "rodded", "unstated"])
def test_the_expected_error_rests_on_the_other_mixtures_that_were_tested_as_their_beds(
    compared: Store, folder: Callable[..., Path], compaction: str
) -> None:
    text = f"material,compaction,packing_density\nA+B,{compaction},0.7\n"
    register(compared, read_path(folder(packing_tests=text) / "packing_tests.csv"))
    reports = [report for report in comparisons(compared) if report.difference is not None]
    tested_otherwise = [report.mixture for report in reports if report.tested_otherwise]
    assert tested_otherwise == (["A+B"] if compaction == "rodded" else [])
    listed_errors = dict(rows_of(compared, "predictions", [], ["prediction_id", "expected_error"]))
    for report in reports:
        others = [other.difference or 0.0 for other in reports if other is not report and not other.tested_otherwise]
        own = sum(value**2 for value in others) / len(others)
        errors = (report.standard_error or 0.0) ** 2 + (report.input_error or 0.0) ** 2
        expected = pytest.approx((errors + own) ** 0.5, rel=1e-9)
        assert (report.expected_error, listed_errors[report.prediction_id]) == (expected, expected)


def test_the_view_of_aggregates_says_what_the_services_compute(compared: Store, formula_runner: Any) -> None:
    def check() -> list[float | None]:
        names, rows = listed(compared, "aggregates", [], [], "", None)
        known = summaries(compared)
        assert [row[0] for row in rows] == [one.name for one in known]
        for row, one in zip(rows, known, strict=True):
            said = dict(zip(names, row, strict=True))
            ends = (one.grading.apertures[-1], one.grading.apertures[0]) if one.grading else (None, None)
            assert (said["finest_mm"], said["coarsest_mm"], said["diameter_mm"]) == (*ends, one.diameter)
            density = one.measured.packing_density if one.measured else None
            assert said["packing_density"] == (None if density is None else pytest.approx(density, abs=1e-12))
            for name in ("delivery", "friction", "friction_low", "friction_high"):
                assert said[name] == getattr(one, name), (one.name, name)
            assert (said["message"] or "") == one.message
        return [one.friction for one in known]

    # C was tested anew since it was calibrated, D was never tested, nor was the new delivery of A
    assert [friction is None for friction in check()] == [False, False, False, False, True, True, True]
    experiments.calibrate(compared, formula_runner(compared), ["C"])
    assert [friction is None for friction in check()] == [False, False, False, False, False, True, True]

    def fails(specimens: Any) -> list[Any]:
        return [NotAtRest("did not come to rest") for _ in specimens]

    fails.engine_version = 9  # type: ignore[attr-defined]
    experiments.calibrate(compared, fails, ["B"])
    assert [friction is None for friction in check()] == [False, False, False, True, False, True, True]


def test_results_of_no_engine_have_an_expected_error_too(compared: Store) -> None:
    with compared.write() as session:
        for mixture in (1, 2, 3):
            rest = {"state": "done", "packing_density": 0.6 + 0.01 * mixture, "standard_error": 0.0}
            session.add(Prediction(mixture_id=mixture, method="toufar", protocol="{}", **rest))
    said = rows_of(compared, "predictions", ["method=toufar"], ["expected_error"])
    assert [row[0] for row in said] == [
        pytest.approx(report.expected_error) for report in comparisons(compared) if report.method == "toufar"
    ]
    assert all(row[0] > 0.0 for row in said)


def test_a_variant_of_a_calibration_is_not_the_current_one(compared: Store) -> None:
    before = rows_of(compared, "aggregates", ["aggregate=pebbles L"], ["friction", "calibration_id"])
    with compared.write() as session:
        found = session.scalars(sa.select(Calibration).where(Calibration.id == before[0][1])).one()
        facts = {column.name: getattr(found, column.name) for column in Calibration.__table__.columns}
        rest = {"id": None, "variant": "pair_friction=mean", "friction": 0.9, "requested_at": now()}
        session.add(Calibration(**facts | rest))
    assert rows_of(compared, "aggregates", ["aggregate=pebbles L"], ["friction", "calibration_id"]) == before
    with compared.read() as session:
        last = store_module.last_calibration(session, found.aggregate_id)
        assert last is not None
        assert last.id == found.id


def test_a_calibration_by_angle_of_repose_is_outdated_by_corrected_angles_and_not_by_densities(
    pebbles: Store,
) -> None:
    experiments.correct(pebbles, {"aggregate:pebbles L": {"repose_angle_deg": "32"}}, "A")
    with pebbles.write() as session:
        kept = {"aggregate_id": 1, "sieve_analysis_id": 1, "method": "repose", "protocol": "{}", "state": "done",
                "diameter_rule": "d50", "diameter_mm": 8.0, "friction": 0.3}  # fmt: skip
        session.add(Calibration(measured_angle_deg=32.0, wall_friction=0.4, **kept))

    def current() -> list[tuple[Any, ...]]:
        return rows_of(pebbles, "aggregates", ["aggregate=pebbles L"], ["friction"])

    assert current() == [(0.3,)]
    density = {"particle_density_kg_m3": "2600", "density_basis": "oven_dry"}
    experiments.correct(pebbles, {"aggregate:pebbles L": density}, "A")
    assert current() == [(0.3,)]
    experiments.correct(pebbles, {"aggregate:pebbles L": {"repose_angle_deg": "35"}}, "A")
    assert current() == [(None,)]


def test_one_mixture_is_compared_without_reading_the_others(compared: Store) -> None:
    loaded = list[Prediction]()

    def note(row: Prediction, _: Any) -> None:
        loaded.append(row)

    whole = {report.mixture: report for report in comparisons(compared)}
    sa.event.listen(Prediction, "load", note)
    try:
        assert comparisons(compared, names=["A+B"]) == [whole["A+B"]]
        assert len(loaded) == 1
    finally:
        sa.event.remove(Prediction, "load", note)
