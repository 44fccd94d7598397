"""Lists: conditions in text, their order, and no scan of a large table."""

import datetime as dt
import operator
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import sqlalchemy as sa
from benchmarks.store_speed import build
from conftest import rows_of
from typer.testing import CliRunner

from pdlab import Lab
from pdlab import store as store_module
from pdlab.cli import app
from pdlab.cli.tables import _show_list
from pdlab.errors import ConditionError
from pdlab.experiments import counted, listed
from pdlab.lab import SHIPPED
from pdlab.models import Prediction, Run
from pdlab.store import Store, open_store
from pdlab.tables import Condition, parse_condition, parse_order

KINDS = {"state": str, "packing_density": float, "finished_at": dt.date}


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
    large = ("SCAN run", "SCAN prediction", "SCAN packing_test", "SCAN p", "SCAN x", "SCAN t")
    return [step for step in steps if step.startswith(large) and "COVERING INDEX" not in step]


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
    assert [step for step in scans if not step.startswith("SCAN comparison")] == []  # a condition on the list
    assert "SEARCH comparison USING INDEX sqlite_autoindex_comparison_1 (mixture_id=?)" in steps


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


def test_a_row_without_a_message_is_in_no_note_beside_one_that_has_one(capsys: pytest.CaptureFixture[str]) -> None:
    _show_list(pd.DataFrame({"aggregate": ["A", "B"], "message": [None, "why"]}), "aggregates", 2, [])
    assert [line for line in capsys.readouterr().out.splitlines() if line.startswith("note")] == ["note: B: why"]
