"""Where a number comes from: found by name, whole, in few queries, drawn as a tree."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import sqlalchemy as sa
from conftest import FormulaRunner
from rich.console import Console

from pdlab import report
from pdlab.errors import InputError, UnknownName
from pdlab.experiments import (
    Way,
    ask_predictions,
    calibrate,
    comparisons,
    correct,
    predict,
    show,
    to_predict,
)
from pdlab.models import Aggregate, Calibration, Mixture, PackingTest, Prediction, Run, SieveAnalysis, now
from pdlab.store import Store
from pdlab.tree import draw


@pytest.fixture
def predicted(pebbles: Store) -> Store:
    predict(pebbles, FormulaRunner(pebbles))
    return pebbles


@contextmanager
def counted(store: Store) -> Iterator[list[str]]:
    statements: list[str] = []

    def note(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if statement.startswith("SELECT"):
            statements.append(statement)

    sa.event.listen(store.reader, "before_cursor_execute", note)
    yield statements
    sa.event.remove(store.reader, "before_cursor_execute", note)


def text_of(facts: dict[str, Any]) -> str:
    console = Console(width=400)
    with console.capture() as out:
        console.print(draw(facts))
    return out.get()


def test_what_waits_is_shown_too_and_what_failed_before_any_bed(predicted: Store) -> None:
    ask_predictions(predicted, to_predict(predicted, ["pebbles L+F 1:1"]), Way("static"), 0)
    facts = show(predicted, "mixture:pebbles L+F 1:1")
    assert facts["last_prediction"]["state"] == "queued"
    assert "no PD, method static, not simulated" in text_of(facts)
    with predicted.write() as session:
        failed = {"state": "failed", "message": "no sieves"}
        session.execute(sa.update(Prediction).where(Prediction.state == "queued").values(failed))
    assert "no sieves" in text_of(show(predicted, "mixture:pebbles L+F 1:1"))
    assert [one.message for one in comparisons(predicted) if one.state == "failed"] == ["no sieves"]
    assert "no sieves" in report.named(predicted, "mixture:pebbles L+F 1:1")


def test_a_prediction_leads_down_to_raw_sieve_text_seeds_and_engine(predicted: Store) -> None:
    facts = show(predicted, "prediction:2")
    assert facts["mixture"]["name"] == "pebbles L+F 1:1"
    assert [fit["aggregate"]["name"] for fit in facts["calibrations"]] == ["pebbles L", "pebbles F"]
    fit = facts["calibrations"][0]
    assert fit["packing_test"]["voids_percent"] == 40.0
    assert [row["raw_text"] for row in fit["sieve_analysis"]["results"]] == ["60.96\t100", "40.64\t0"]
    with predicted.read() as session:
        runs = {run.specimen_hash: run for run in session.scalars(sa.select(Run))}
    for named in (*fit["runs"], *facts["runs"]):
        row = runs[named["specimen_hash"]]
        assert (named["seed"], named["engine_version"]) == (row.seed, row.engine_version)
        assert named["specimen"] == json.loads(row.specimen)
        assert {"numba_version", "processor", "packing_density"} <= named.keys()
    assert {run["seed"] for run in facts["runs"]} == {1, 2, 3, 4}
    json.dumps(facts)


def test_a_kept_text_that_is_broken_is_a_sentence(predicted: Store) -> None:
    with predicted.write() as session:
        session.execute(sa.update(Run).values(specimen="{broken"))
    with pytest.raises(InputError, match=r"^run:\w+: specimen '\{broken' is not what pdlab wrote"):
        show(predicted, "prediction:2")


def test_a_descent_takes_as_many_queries_with_few_runs_as_with_many(pebbles: Store) -> None:
    found = []
    for seeds in (2, 8):
        predict(pebbles, FormulaRunner(pebbles), ["pebbles L+M 1:1"], Way(seeds=seeds))
        with counted(pebbles) as statements:
            facts = show(pebbles, "pebbles L+M 1:1")
        found.append((len(statements), len(facts["last_prediction"]["runs"])))
    assert found[0][0] == found[1][0] < 45
    assert found[0][1] < found[1][1]


def test_a_row_is_found_by_its_bare_name_where_it_is_the_only_one(predicted: Store) -> None:
    for text, address in (
        ("pebbles L", "aggregate:pebbles L"),
        ("pebbles L+M 1:1", "mixture:pebbles L+M 1:1"),
        ("3", "prediction:3"),
        ("calibration:pebbles M", "calibration:2"),
        ("calibration:2", "calibration:2"),
        ("sieve_analysis:1", "sieve_analysis:1"),
        ("packing_test:4", "packing_test:4"),
    ):
        assert show(predicted, text)["address"] == address
    digest = show(predicted, "prediction:1")["runs"][0]["specimen_hash"]
    assert show(predicted, digest[:8])["rests_on_it"] == {"prediction": ["1"]}


def test_a_name_with_several_meanings_or_none_is_refused(predicted: Store) -> None:
    with predicted.write() as session:
        session.add_all([Mixture(name="1"), Aggregate(name="A", delivery="x"), Aggregate(name="A", delivery="y")])
    for text, error, message in (
        ("1", InputError, "'1' names several things; write one of mixture:1, prediction:1"),
        ("gravel", UnknownName, "the store holds nothing named 'gravel'"),
        ("prediction:99", UnknownName, "holds no prediction '99'"),
        ("calibration:A@x", UnknownName, "was not calibrated yet"),
        ("aggregate:A", InputError, "came in 2 deliveries; write one of aggregate:A@x, aggregate:A@y"),
        ("sieve_result:1/0", InputError, r"a sieve_result \('sieve_result:1/0'\) cannot be named here"),
    ):
        with pytest.raises(error, match=message):
            show(predicted, text)
    assert show(predicted, "aggregate:A@y")["delivery"] == "y"


def test_the_history_of_a_deleted_row_is_not_that_of_a_new_one_with_its_key(predicted: Store) -> None:
    correct(predicted, {"packing_test:6": {"voids_percent": "37.8"}}, "Anna")
    assert [one["new_value"] for one in show(predicted, "packing_test:6")["corrections"]] == ["37.8"]
    with predicted.write() as session:
        old = session.get(PackingTest, 6)
        assert old is not None
        session.delete(old)
        session.flush()
        session.add(PackingTest(id=6, mixture_id=3, compaction="loose", voids_percent=38.0, raw_text=""))
    assert show(predicted, "packing_test:6")["corrections"] == []


def test_the_tree_names_every_row_and_every_run(predicted: Store) -> None:
    correct(predicted, {"sieve_result:1/1": {"aperture_mm": "40.6"}}, "Anna", "typing error")
    facts = show(predicted, "pebbles L+M 1:1")
    text = text_of(facts)
    last = facts["last_prediction"]
    for run in (*last["runs"], *last["calibrations"][0]["runs"]):
        assert f"run:{run['specimen_hash'][:12]}: seed {run['seed']}, PD {run['packing_density']:.5f}" in text
    assert f"PD {last['packing_density']:.4f} ± {last['standard_error']:.4f} (simulation)" in text
    assert "sieve_result:1/1: 40.6 mm, passing_percent 0 (as entered: 40.64 0)" in text
    assert "corrected by Anna on " in text
    assert "aperture_mm 40.64 → 40.6 (typing error)" in text
    assert "on it rest: prediction:1" in text


def test_a_failed_calibration_is_shown_with_its_reason(pebbles: Store) -> None:
    with pebbles.write() as session:
        test = session.get(PackingTest, 1)
        assert test is not None
        test.voids_percent = 50.0
    assert calibrate(pebbles, FormulaRunner(pebbles), ["pebbles L"])[0].error is not None
    text = text_of(show(pebbles, "calibration:pebbles L"))
    assert "failed" in text
    assert "out of reach" in text


def test_what_is_entered_and_not_yet_used_is_shown_too(pebbles: Store) -> None:
    facts = show(pebbles, "pebbles L")
    assert "last_calibration" not in facts
    assert facts["rests_on_it"]["mixture"] == ["pebbles L+F 1:1", "pebbles L+M 1:1"]
    assert "sieve_result:1/0: 60.96 mm" in text_of(facts)
    with pebbles.read() as session:
        assert session.scalars(sa.select(SieveAnalysis)).first() is not None


def test_a_calibration_by_angle_of_repose_is_shown_without_a_density_test(pebbles: Store) -> None:
    with pebbles.write() as session:
        kept = {"aggregate_id": 1, "sieve_analysis_id": 1, "protocol": '{"compaction": "loose"}', "state": "done"}
        angle = {"method": "repose", "measured_angle_deg": 32.0, "wall_friction": 0.4, "variant": "local_damping=0"}
        sizes = {"diameter_rule": "d50", "diameter_mm": 8.0, "spheres": "[[8.0, 0.6], [4.0, 0.4]]"}
        session.add(Calibration(friction=0.3, requested_at=now(), **kept, **angle, **sizes))
    facts = show(pebbles, "calibration:1")
    assert facts["packing_test"] is None
    assert facts["spheres"] == [[8.0, 0.6], [4.0, 0.4]]
    text = text_of(facts)
    assert "measured angle of repose 32°, wall friction 0.4, diameter 8 mm (d50), method repose" in text
    assert "method repose with local_damping=0, loose" in text
    assert "packing_test" not in text
