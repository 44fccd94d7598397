"""Files, pragmas, constraints and transactions of the store."""

import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from conftest import both

from pdlab.errors import StoreError
from pdlab.models import Aggregate, Base, Calibration, Run, RunState, SieveAnalysis, SieveResult
from pdlab.store import Store, databases, find_aggregate, open_store, store_url, upgrade


def test_a_missing_file_is_made_by_the_migrations_and_said(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'lab.db'}"
    assert open_store(url).created
    assert not open_store(url).created


def test_the_url_comes_from_the_option_else_the_environment_else_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDLAB_STORE", raising=False)
    assert store_url(None) == "sqlite:///pdlab.db"
    monkeypatch.setenv("PDLAB_STORE", "sqlite:///other.db")
    assert store_url(None) == "sqlite:///other.db"
    assert store_url("lab.db") == "sqlite:///lab.db"


def test_a_writer_has_the_pragmas_that_keep_what_was_acknowledged(tmp_path: Path) -> None:
    opened = open_store(str(tmp_path / "lab.db"))
    with opened.write() as session:
        values = {
            name: session.connection().exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys")
        }
    assert values == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1}


def test_a_file_that_is_no_store_is_refused_and_left_as_it_was(tmp_path: Path) -> None:
    text = tmp_path / "notes.db"
    text.write_text("these are my notes, not a database, and long enough to be looked at " * 20)
    before = text.read_bytes()
    with pytest.raises(StoreError, match=r"is no pdlab store .*choose another file"):
        open_store(str(text))
    assert text.read_bytes() == before
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE music (title TEXT)")
    connection.close()
    before = other.read_bytes()
    for call in (open_store, upgrade):
        with pytest.raises(StoreError, match=r"holds other tables \(music\)"):
            call(str(other))
    assert other.read_bytes() == before


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="does not exist"):
        open_store(str(tmp_path / "gone" / "lab.db"))


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(StoreError, match="is no store address"):
        open_store("://")


@pytest.mark.parametrize(
    "row",
    [
        Aggregate(name="", delivery=""),
        Aggregate(name="A", delivery="", particle_density_kg_m3=-1.0, density_basis="ssd"),
        Aggregate(name="A", delivery="", particle_density_kg_m3=2600.0),
        Aggregate(name="A", delivery="", particle_density_kg_m3=2600.0, density_basis="wet"),
        Run(specimen_hash="short", specimen="{}", engine_version=1, seed=1, spheres=1, state="queued"),
        Run(specimen_hash="0" * 64, specimen="{}", engine_version=1, seed=1, spheres=1, state="done"),
        Run(specimen_hash="0" * 64, specimen="{}", engine_version=1, seed=1, spheres=1, state="lost"),
        Run(specimen_hash="0" * 64, specimen="{}", engine_version=1, seed=1, spheres=1, state="done",
            repose_angle_deg=91.0),
        RunState(specimen_hash="1" * 64, steps=1, archive=b""),
        SieveAnalysis(aggregate_id=99, kind="retained_g"),
    ],
)  # fmt: skip
def test_rows_that_cannot_be_are_refused_by_the_database(store: Store, row: Base) -> None:
    with pytest.raises(sa.exc.IntegrityError), store.write() as session:
        session.add(row)


def test_a_run_that_is_done_has_a_packing_density_or_an_angle_of_repose(store: Store) -> None:
    with store.write() as session:
        for digit, result in {"0": {"packing_density": 0.6}, "1": {"repose_angle_deg": 32.0}}.items():
            kept = {"specimen_hash": digit * 64, "specimen": "{}", "engine_version": 1, "seed": 1, "spheres": 1}
            session.add(Run(state="done", **kept, **result))
    with store.read() as session:
        assert session.scalar(sa.select(sa.func.count()).select_from(Run)) == 2


@pytest.mark.parametrize("column", ["measured_angle_deg", "wall_friction", "leave_out_below_mm"])
def test_what_a_calibration_cannot_rest_on_is_refused_by_the_database(pebbles: Store, column: str) -> None:
    kept = {"aggregate_id": 1, "sieve_analysis_id": 1, "method": "repose", "protocol": "{}", "diameter_rule": "d50",
            "diameter_mm": 8.0}  # fmt: skip
    with pebbles.write() as session:
        session.add(Calibration(**kept, **{column: 0.5}))
    with pytest.raises(sa.exc.IntegrityError), pebbles.write() as session:
        session.add(Calibration(**kept, **{column: -0.5}))


def test_one_delivery_of_a_name_stands_once(store: Store) -> None:
    with store.write() as session:
        session.add(Aggregate(name="A", delivery="1"))
    with pytest.raises(sa.exc.IntegrityError), store.write() as session:
        session.add(Aggregate(name="A", delivery="1"))


def test_a_sieve_result_has_exactly_one_value(store: Store) -> None:
    result = SieveResult(position=0, aperture_mm=8.0, retained_g=1.0, passing_percent=5.0, raw_text="8 1")
    analysis = SieveAnalysis(kind="retained_g", results=[result])
    with pytest.raises(sa.exc.IntegrityError), store.write() as session:
        session.add(Aggregate(name="A", delivery="", sieve_analyses=[analysis]))


@both
def test_a_block_that_fails_keeps_nothing(opened: Store) -> None:
    def fail() -> None:
        with opened.write() as session:
            session.add(Aggregate(name="A", delivery=""))
            session.flush()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    with opened.read() as session:
        assert find_aggregate(session, "A", "") is None


@both
def test_a_store_locked_by_another_writer_is_a_sentence(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(databases, "LOCK_TIMEOUT", 0.1)
    one, other = open_store(address), open_store(address)
    refused = pytest.raises(StoreError, match=r"cannot be used \(.*lock.*\); end what else writes to it, or try again")
    with one.write() as session:
        session.add(Aggregate(name="A", delivery=""))
        session.flush()
        with refused, other.write() as late:
            late.add(Aggregate(name="B", delivery=""))
    with other.read() as session:
        assert find_aggregate(session, "A", "") is not None
    one.close()
    other.close()


@both
def test_writers_wait_for_each_other_so_that_no_update_is_lost(opened: Store) -> None:
    with opened.write() as session:
        session.add(Aggregate(name="A", delivery="", shape="0"))

    def count_up(_: int) -> None:
        with opened.write() as session:
            session.execute(  # read, then write: not through the row's version, which would refuse
                sa.update(Aggregate).values(shape=str(int(session.scalars(sa.select(Aggregate.shape)).one() or "") + 1))
            )

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(count_up, range(40)))
    with opened.read() as session:
        assert session.scalars(sa.select(Aggregate.shape)).one() == "40"


@both
def test_a_reader_sees_one_state_while_others_write(opened: Store) -> None:
    count = sa.select(sa.func.count()).select_from(Aggregate)
    with opened.read() as session:
        assert session.scalar(count) == 0

        def write() -> None:
            with opened.write() as other:
                other.add(Aggregate(name="A", delivery=""))

        thread = threading.Thread(target=write)
        thread.start()
        thread.join()
        assert session.scalar(count) == 0
    with opened.read() as session:
        assert session.scalar(count) == 1


@both
def test_stores_opened_at_once_are_made_once(address: str) -> None:
    with ThreadPoolExecutor(4) as threads:
        stores = list(threads.map(lambda _: open_store(address), range(4)))
    with stores[0].read() as session:
        assert len(session.connection().exec_driver_sql("SELECT version_num FROM alembic_version").all()) == 1
    for made in stores:
        made.close()


@both
def test_numbers_of_numpy_and_nan_come_back_as_plain_values(opened: Store) -> None:
    steps, density = np.int64(5), np.float64(0.1) + 0.2
    row = Run(specimen_hash="0" * 64, specimen="{}", engine_version=1, seed=1, spheres=1, state="failed")
    row.steps, row.packing_density, row.height = steps, density, float("nan")
    with opened.write() as session:
        session.add(row)
    with opened.read() as session:
        kept = session.scalars(sa.select(Run)).one()
        plain = session.connection().exec_driver_sql("SELECT steps, packing_density, height FROM run").one()
    assert (kept.steps, kept.packing_density, kept.height) == tuple(plain) == (5, 0.1 + 0.2, None)
    assert type(plain[0]) is int
    assert kept.created_at == row.created_at


def test_a_folder_and_a_foreign_database_with_our_revision_are_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is a folder"):
        open_store(str(tmp_path))
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE alembic_version (version_num TEXT)")
        connection.execute("INSERT INTO alembic_version VALUES ('0001')")
    connection.close()
    for call in (open_store, upgrade):
        with pytest.raises(StoreError, match="no pdlab store"):
            call(str(path))
