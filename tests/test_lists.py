"""Lists: conditions in text, what the views say beside what the services compute, and no scan of a large table."""

import datetime as dt
import operator
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from benchmarks.store_speed import build
from typer.testing import CliRunner

from pdlab import Lab, experiments
from pdlab import store as store_module
from pdlab.calibration import METHOD
from pdlab.cli import app
from pdlab.errors import ConditionError, NotAtRest
from pdlab.experiments import comparisons, counted, listed, register, summaries
from pdlab.lab import SHIPPED
from pdlab.models import Calibration, Mixture, Prediction, Run, now
from pdlab.store import Store, open_store
from pdlab.tables import Condition, parse_condition, parse_order, read_path

KINDS = {"state": str, "packing_density": float, "finished_at": dt.date}
Rows = list[tuple[Any, ...]]


def rows_of(target: Store, what: str, where: list[str], columns: list[str], sort: str = "") -> Rows:
    return listed(target, what, where, columns, sort, None)[1]


@pytest.mark.parametrize(
    ("text", "condition"),
    [
        ("state=done", Condition("state", "=", "done")),
        (" state != a=b ", Condition("state", "!=", "a=b")),
        ("state~do", Condition("state", "~", "do")),
        ("packing_density>=0,6", Condition("packing_density", ">=", 0.6)),
        ("packing_density<1e-3", Condition("packing_density", "<", 0.001)),
        ("packing_density=", Condition("packing_density", "=", None)),
        ("finished_at<=2026-03-31", Condition("finished_at", "<=", dt.date(2026, 3, 31))),
    ],
)
def test_a_condition_is_a_column_a_comparison_and_a_value_of_the_columns_kind(text: str, condition: Condition) -> None:
    assert parse_condition(text, KINDS) == condition


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("done", "'done' is no condition; write a column, one of = != < <= > >= ~, and a value"),
        ("colour=red", "'colour' is no column of this list; use one of state, packing_density, finished_at"),
        ("packing_density>high", "packing_density holds a number: 'high' is no number"),
        ("packing_density~0.6", "searches for text, but packing_density holds a number; use = != < <= > >="),
        ("finished_at>May", "finished_at holds a day: 'May' is no date; write it like 2026-03-31"),
        ("state>", "'state>' has no value; give one, or write state= for those where it is missing"),
    ],
)
def test_what_is_no_condition_is_said_in_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ConditionError) as caught:
        parse_condition(text, KINDS)
    assert sentence in str(caught.value)


def test_an_order_names_columns_that_fall_by_a_minus() -> None:
    assert parse_order("state, -packing_density", KINDS) == [("state", False), ("packing_density", True)]
    with pytest.raises(ConditionError, match="'colour' is no column"):
        parse_order("-colour", KINDS)


@pytest.fixture
def beds(store: Store) -> Store:
    """Twelve runs on three days, every fourth failed, with a bar in a name and a percent sign in an error."""
    first = dt.datetime(2026, 1, 1, 23, 0, tzinfo=dt.UTC)
    with store.write() as session:
        session.add_all(
            Run(
                specimen_hash=f"{k:064x}", specimen="{}", engine_version=3, seed=k % 3, spheres=1000 * k,
                state="failed" if k % 4 == 0 else "done", packing_density=None if k % 4 == 0 else 0.55 + k / 100,
                error="100% OFF_balance" if k % 4 == 0 else None, finished_at=first + dt.timedelta(hours=4 * k),
            )
            for k in range(12)
        )  # fmt: skip
    return store


@pytest.mark.parametrize("sign", ["=", "!=", "<", "<=", ">", ">="])
def test_numbers_texts_and_days_compare_as_in_python(beds: Store, sign: str) -> None:
    same = {"=": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt,
            ">=": operator.ge}[sign]  # fmt: skip
    every = rows_of(beds, "runs", [], ["specimen_hash", "spheres", "state", "finished_at"])
    assert len(every) == 12
    for column, place, text, value in (
        ("spheres", 1, "5000", 5000),
        ("state", 2, "done", "done"),
        ("finished_at", 3, "2026-01-02", dt.date(2026, 1, 2)),
    ):
        kept = rows_of(beds, "runs", [f"{column}{sign}{text}"], ["specimen_hash"])
        wanted = [row for row in every if same(row[place].date() if place == 3 else row[place], value)]
        assert [row[0] for row in kept] == [row[0] for row in wanted], column
        assert counted(beds, "runs", [f"{column}{sign}{text}"]) == len(wanted)


def test_an_empty_value_means_missing_and_what_is_missing_is_different(beds: Store) -> None:
    assert counted(beds, "runs", ["packing_density="]) == 3
    assert counted(beds, "runs", ["packing_density!="]) == 9
    assert counted(beds, "runs", ["packing_density!=0.5"]) == 12
    assert counted(beds, "runs", ["packing_density<1"]) == 9


def test_a_column_of_whole_numbers_is_compared_with_any_number(beds: Store) -> None:
    assert counted(beds, "runs", ["spheres>5000.5"]) == 6
    assert counted(beds, "runs", ["seed=0.5"]) == 0


def test_contains_knows_no_case_and_no_wildcards(beds: Store) -> None:
    assert counted(beds, "runs", ["error~off_BAL"]) == 3
    assert counted(beds, "runs", ["error~0%"]) == 3
    assert counted(beds, "runs", ["error~1%"]) == 0
    assert counted(beds, "runs", ["error~off%bal"]) == 0


def test_all_conditions_are_met_and_what_is_missing_comes_last_in_either_order(beds: Store) -> None:
    rows = rows_of(beds, "runs", ["state=done", "spheres>=5000"], ["spheres"], "-packing_density")
    assert [row[0] for row in rows] == [11000, 10000, 9000, 7000, 6000, 5000]
    for sort in ("packing_density", "-packing_density"):
        assert [row[0] for row in rows_of(beds, "runs", [], ["packing_density"], sort)][-3:] == [None] * 3
    names, page = listed(beds, "runs", [], [], "seed,-spheres", 2)
    assert [(row[names.index("seed")], row[names.index("spheres")]) for row in page] == [(0, 9000), (0, 6000)]
    with pytest.raises(ConditionError, match="a list of 0 rows"):
        listed(beds, "runs", [], [], "", 0)


def test_runs_are_listed_the_newest_first(beds: Store) -> None:
    assert [row[0] for row in rows_of(beds, "runs", [], ["spheres"])] == [1000 * k for k in range(11, -1, -1)]


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


def test_the_expected_error_rests_on_the_other_mixtures(compared: Store) -> None:
    reports = [report for report in comparisons(compared) if report.difference is not None]
    for report in reports:
        others = [other.difference or 0.0 for other in reports if other is not report]
        own = sum(value**2 for value in others) / len(others)
        errors = (report.standard_error or 0.0) ** 2 + (report.input_error or 0.0) ** 2
        assert report.expected_error == pytest.approx((errors + own) ** 0.5, rel=1e-9)


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
        assert [report.mixture for report in comparisons(compared, newest=2)] == ["A+B+C", "new"]
    finally:
        sa.event.remove(Prediction, "load", note)


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A tenth of the store of the benchmark."""
    opened = open_store(str(tmp_path_factory.mktemp("large") / "lab.db"))
    build(opened, 0.1)
    yield opened
    opened.close()


def plans(target: Store, call: Callable[[], Any]) -> list[str]:
    """Return SQLite's query plan of each statement that a call sends."""
    sent = list[tuple[str, Any]]()

    def note(_: Any, __: Any, text: str, values: Any, *___: Any) -> None:
        sent.append((text, values))

    sa.event.listen(target.reader, "before_cursor_execute", note)
    try:
        call()
    finally:
        sa.event.remove(target.reader, "before_cursor_execute", note)
    assert sent
    with target.read() as session:
        connection = session.connection()
        explained = (connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}", values) for text, values in sent)
        return [step[3] for plan in explained for step in plan]


def slow(steps: list[str]) -> list[str]:
    """Return the steps that read the whole of a large table: neither an index nor an index that holds all."""
    return [step for step in steps if step.startswith(("SCAN run", "SCAN prediction", "SCAN p", "SCAN x", "SCAN t"))
            and "COVERING INDEX" not in step and not step.startswith("SCAN pairs")]  # fmt: skip


TRIED = {str: ("=", "!=z", "~z"), float: ("=", "!=0", ">0.6"), dt.date: (">2026-01-01",)}


@pytest.mark.parametrize("what", store_module.SHOWN)
def test_no_list_reads_the_whole_of_runs_predictions_or_tests(large: Store, what: str) -> None:
    kinds = store_module.column_kinds(what)
    for column in store_module.SHOWN[what]:
        for text in TRIED[kinds[column]]:
            for sort in (column, "-" + column, ""):
                steps = plans(large, lambda: listed(large, what, [column + text], [], sort, 30))  # noqa: B023
                assert not slow(steps), (column, text, sort)


def test_a_page_of_the_newest_runs_reads_no_more_than_the_page(large: Store) -> None:
    steps = plans(large, lambda: listed(large, "runs", [], [], "", 30))
    assert "SCAN run USING COVERING INDEX ix_run_list" in steps
    assert "USE TEMP B-TREE FOR ORDER BY" not in steps


def test_what_asks_for_one_mixture_or_run_searches_by_index(large: Store) -> None:
    facts = {"mixture_id": 7, "state": "done", "packing_density": 0.6}

    def find(session: Any) -> None:
        digest = session.scalar(sa.select(Run.specimen_hash).limit(1))
        store_module.newest_predictions(session, [7])
        store_module.equal_results(session, Prediction, facts, set())
        store_module.done_runs(session, [digest])
        store_module.list_rows(session, "predictions", ["measured", "state"], [("mixture", "=", "mix 00007")])
        with pytest.raises(store_module.selects.UnknownName, match="keeps no bed"):
            store_module.find_bed(session, digest[:16])

    def call() -> None:
        with large.read() as session:
            find(session)

    steps = plans(large, call)
    digest_step = "SCAN run USING COVERING INDEX sqlite_autoindex_run_1"  # the test's own first statement
    scans = [step for step in steps if step.startswith("SCAN") and step != digest_step]
    assert sum("ix_prediction_newest (mixture_id=?)" in step for step in steps) == 2
    assert sum("ix_prediction_newest (mixture_id=? AND method=? AND variant=?" in step for step in steps) == 2
    assert set(scans) <= {"SCAN c", "SCAN k"}  # calibrations and corrections: are they outdated?


def test_the_runs_of_many_specimens_are_found(large: Store) -> None:
    with large.read() as session:
        driver: Any = session.connection().connection.driver_connection
        driver.setlimit(sqlite3.SQLITE_LIMIT_VARIABLE_NUMBER, 32_766)  # SQLite's own; some builds allow more
        digests = list(session.scalars(sa.select(Run.specimen_hash).where(Run.state == "done")))
        unknown = [f"{k:064x}" for k in range(40_000)]
        assert store_module.done_runs(session, [*unknown, *digests]).keys() == set(digests)


def test_the_terminal_shows_a_page_and_a_file_gets_all(large: Store, tmp_path: Path) -> None:
    def ls(*words: str) -> str:
        done = CliRunner().invoke(app, ["ls", *words, "--store", large.url])
        assert done.exit_code == 0, done.output
        return done.output

    in_all = counted(large, "runs", ["state=failed"])
    text = ls("runs", "state=failed", "--sort", "-seconds", "--columns", "specimen_hash,seconds,finished_at")
    assert f"the first 30 of {in_all} rows; more with --limit, all with --csv or -o FILE" in text
    assert "2026-01-" in text
    text = ls("runs", "state=failed", "--csv", "--columns", "specimen_hash,seconds")
    assert text.splitlines()[0] == "specimen_hash,seconds"
    assert len(text.splitlines()) == in_all + 1
    ls("runs", "--limit", "3", "-o", str(tmp_path / "runs.csv"))
    assert len((tmp_path / "runs.csv").read_text(encoding="utf-8").splitlines()) == 4
    assert "no runs meet these conditions" in ls("runs", "spheres<1")


def test_lab_gives_the_same_as_frames(tmp_path: Path) -> None:
    with Lab(str(tmp_path / "lab.db")) as lab:
        assert list(lab.runs().columns) == list(store_module.SHOWN["runs"])
        lab.import_tables(SHIPPED)
        frame = lab.aggregates(where="diameter_mm>20", columns=["aggregate", "packing_density"], sort="-diameter_mm")
        assert list(frame["aggregate"]) == ["pebbles L", "pebbles M"]
        assert lab.count("predictions", ["state=open", "measured>0.63"]) == 2
        assert list(lab.predictions(sort="-measured", limit=1)["mixture"]) == ["pebbles L+F 1:1"]
