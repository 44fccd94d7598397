"""Damaged rows: whatever a column of a store holds, every verb and view shows what it can, or names the row."""

import random
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
import streamlit as st
from conftest import FormulaPool, FormulaRunner
from shell import pdlab
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE

from pdlab import experiments
from pdlab.batch.runner import Runner
from pdlab.batch.working import answer
from pdlab.experiments import Way, damages, predict, register, shipped
from pdlab.experiments.sweeps import sweep_aggregates
from pdlab.lab import SHIPPED
from pdlab.models import Base, Draft, Prediction, Run
from pdlab.page.app import VIEWS
from pdlab.store import Store, open_store
from pdlab.tables import read_path

JSON = ("protocol", "specimen", "slab_shares", "spheres", "curve", "asked", "content")
BROKEN: dict[type, tuple[Any, ...]] = {str: ("bogus",), int: ("bogus", -3), float: ("bogus", -3), bytes: (b"bogus",)}
REPORT = ("report", "mixture:pebbles L+M 1:1", "-o", "m.html")
VERBS = (
    *(("ls", what) for what in ("aggregates", "mixtures", "runs", "predictions", "corrections")),
    *(("show", what) for what in ("mixture:pebbles L+M 1:1", "aggregate:pebbles L", "prediction:1", "prediction:7",
                                  "calibration:1", "sweep:1", "packing_test:1", "sieve_analysis:1")),
    ("compare",), ("export", "out"),
    REPORT, (*REPORT[:-1], "o.html", "--method", "ordered"),
    ("report", "aggregate:pebbles L", "-o", "a.html"),
)  # fmt: skip
ASKED = {"mixtures": {"mixture": "2"}, "calibration": {"aggregate": "1"}, "proportions": {"sweep": "1"},
         "new-aggregate": {"draft": "1"}}  # fmt: skip
"""What each view shows of the store, where it does not by itself."""
Damage = tuple[sa.Table, sa.Column[Any], Any]


def all_damages() -> list[Damage]:
    """Every column but keys, with each kind of what it cannot hold."""
    out = list[Damage]()
    for table in Base.metadata.sorted_tables:
        for column in table.columns:
            if table.name != "comparison" and not column.primary_key and not column.foreign_keys:
                broken = BROKEN.get(column.type.python_type, ("bogus",))
                values = ("{", "7", "[]", '{"bogus": 1}', "null") if column.name in JSON else broken
                out += [(table, column, value) for value in (*values, *(() if column.nullable else (None,)))]
    return out


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with rows in every table but that of beds."""
    path = tmp_path_factory.mktemp("sound") / "lab.db"
    target = open_store(str(path))
    with pytest.MonkeyPatch.context() as patched:
        shipped.write_table(path.with_name("runs.csv"), [])
        patched.setattr(shipped, "TABLE", path.with_name("runs.csv"))
        fill(target)
    target.close()
    return path


def fill(target: Store) -> None:
    register(target, read_path(SHIPPED))
    runner = FormulaRunner(target)
    for method in ("graded", "drop_and_roll", "ordered", "monosized"):
        predict(target, runner, (), Way(method))
    sweep_aggregates(target, runner, ["pebbles L", "pebbles F"])
    experiments.correct(target, {"aggregate:pebbles L": {"source": "pit"}}, "A", "a typing error")
    experiments.ask_predictions(target, experiments.to_predict(target, ["pebbles L+F 1:1"]), Way("static"), 0)
    with target.write() as session:
        session.add(Draft(kind="aggregate", content="{}"))
        session.execute(sa.update(Run).values(slab_shares="[1.0]"))


@pytest.fixture
def work(sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("PDLAB_STORE", f"sqlite:///{tmp_path / 'lab.db'}")
    yield tmp_path
    st.cache_resource.clear()


def damage(sound: Path, work: Path, damaged: Damage) -> bool:
    """Put a copy of the store with a damaged column into a folder; return whether SQLite takes it at all."""
    table, column, value = damaged
    for old in work.iterdir():
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    shutil.copy(sound, work / "lab.db")
    done = " WHERE state = 'done'" if "state" in table.columns else ""
    with closing(sqlite3.connect(work / "lab.db")) as connection:
        connection.execute("PRAGMA ignore_check_constraints = ON")
        try:
            connection.execute(f"UPDATE {table.name} SET {column.name} = ?{done}", (value,))
        except sqlite3.IntegrityError:
            return False
        connection.commit()
    return True


def check(work: Path, damaged: Damage, verbs: list[tuple[str, ...]], views: list[str]) -> None:
    """See that every verb and view shows what it can, or says a sentence."""
    table, column, value = damaged
    for verb in verbs:
        done = pdlab(*verb, folder=work)
        assert done.returncode in (0, 2), (table.name, column.name, value, verb, done.stderr)
    st.cache_resource.clear()
    for view in views:
        app = AppTest.from_file(str(PAGE), default_timeout=60)
        app._page_hash = calc_hash(view)
        for name, asked in ASKED.get(view, {}).items():
            app.query_params[name] = asked
        app.run()
        assert not app.exception, (table.name, column.name, value, view, app.exception)


@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_row_ends_in_a_sentence(sound: Path, work: Path, seed: int) -> None:
    draw = random.Random(seed)
    damaged = draw.choice([one for one in all_damages() if one[1].name in JSON or one[2] == "bogus"])
    if damage(sound, work, damaged):
        check(work, damaged, draw.sample(VERBS, 4), draw.sample(list(VIEWS), 1))


@pytest.mark.slow
@pytest.mark.parametrize("damaged", all_damages(), ids=lambda one: f"{one[0].name}.{one[1].name}={one[2]!r}")
def test_any_damaged_row_ends_in_a_sentence(sound: Path, work: Path, damaged: Damage) -> None:
    if damage(sound, work, damaged):
        check(work, damaged, list(VERBS), list(VIEWS))


CASES = {
    ("calibration", "protocol", "{"): (
        ("report", "mixture:pebbles L+M 1:1", "--method", "graded", "-o", "m.html"),
        "calibration:",
    ),
    ("calibration", "method", "bogus"): (REPORT, "calibration:"),
    ("calibration", "friction", -3): (("report", "aggregate:pebbles L", "-o", "a.html"), "calibration:"),
    ("prediction", "method", "bogus"): (
        ("report", "mixture:pebbles L+M 1:1", "--method", "graded", "-o", "m.html"),
        "prediction:",
    ),
    ("prediction", "protocol", "[]"): (("compare",), "prediction:"),
    ("run", "specimen", "7"): (("show", "prediction:1"), "run:"),
    ("sweep", "curve", "{"): (("show", "sweep:1"), "sweep:"),
    ("packing_test", "created_at", "bogus"): (("show", "aggregate:pebbles L"), "packing_test:"),
    ("aggregate", "particle_density_kg_m3", "bogus"): (("report", "aggregate:pebbles L", "-o", "a.html"), "aggregate:"),
}


@pytest.mark.parametrize("damaged", CASES)
def test_the_sentence_names_the_row(sound: Path, work: Path, damaged: tuple[str, str, Any]) -> None:
    table = Base.metadata.tables[damaged[0]]
    assert damage(sound, work, (table, table.columns[damaged[1]], damaged[2]))
    verb, row = CASES[damaged]
    done = pdlab(*verb, folder=work)
    assert (done.returncode, done.stderr.startswith(row)) == (2, True), done


def test_a_sound_store_has_no_damage_and_its_errors_stay_as_they_are(store: Store) -> None:
    fill(store)
    assert not list(damages(store))
    with pytest.raises(ValueError, match="ours"), experiments.damage_named(store):
        raise ValueError("ours")


def test_a_wish_that_is_damaged_fails_and_says_why(opened: Store) -> None:
    register(opened, read_path(SHIPPED))
    wished = experiments.ask_predictions(opened, experiments.to_predict(opened, ["pebbles L+F 1:1"]), Way("static"), 0)
    with opened.write() as session:
        session.execute(sa.update(Prediction).values(asked="[]"))
    with closing(Runner(opened, FormulaPool())) as runner:
        ((_, error),) = answer(runner, list(wished.wishes.values()))
    assert "prediction:1: asked '[]' is not what pdlab wrote" in str(error)
    with opened.read() as session:
        assert session.scalars(sa.select(Prediction.state)).all() == ["failed"]
