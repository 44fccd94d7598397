"""Revisions, pragmas, constraints and transactions of the store."""

import sqlite3
from pathlib import Path

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from pdlab.errors import StoreError
from pdlab.models import Aggregate, Base, Run, RunState, SieveAnalysis, SieveResult
from pdlab.store import Store, find_aggregate, open_store, opening, store_url, upgrade


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


@pytest.mark.parametrize(("revision", "message"), [("9999", "newer than"), ("0000", "older than .*pdlab db upgrade")])
def test_a_store_of_another_revision_says_what_to_do(
    tmp_path: Path, revision: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "lab.db"
    open_store(str(path)).close()
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE alembic_version SET version_num = ?", (revision,))
    connection.close()
    if revision == "0000":
        monkeypatch.setattr(opening, "_known_revisions", lambda: {"0000", "0001"})
    with pytest.raises(StoreError, match=message):
        open_store(str(path))
    if revision == "9999":
        with pytest.raises(StoreError, match=message):
            upgrade(str(path))


def test_upgrade_makes_a_store_once(tmp_path: Path) -> None:
    url = str(tmp_path / "lab.db")
    assert upgrade(url)[0] is None
    before, after = upgrade(url)
    assert before == after


def test_models_equal_migrations(store: Store) -> None:
    assert isinstance(store.writer, sa.Connection)
    assert compare_metadata(MigrationContext.configure(store.writer), Base.metadata) == []


def test_checks_equal_migrations(store: Store) -> None:
    assert isinstance(store.writer, sa.Connection)
    inspector = sa.inspect(store.writer)
    for table in Base.metadata.sorted_tables:
        wanted = {str(check.name) for check in table.constraints if isinstance(check, sa.CheckConstraint)}
        assert {check["name"] for check in inspector.get_check_constraints(table.name)} == wanted, table.name


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
        RunState(specimen_hash="1" * 64, steps=1, archive=b""),
        SieveAnalysis(aggregate_id=99, kind="retained_g"),
    ],
)
def test_rows_that_cannot_be_are_refused_by_the_database(store: Store, row: Base) -> None:
    with pytest.raises(sa.exc.IntegrityError), store.write() as session:
        session.add(row)


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


def test_a_block_that_fails_keeps_nothing(tmp_path: Path) -> None:
    opened = open_store(str(tmp_path / "lab.db"))

    def fail() -> None:
        with opened.write() as session:
            session.add(Aggregate(name="A", delivery=""))
            session.flush()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    with opened.read() as session:
        assert find_aggregate(session, "A", "") is None


def test_a_store_locked_by_another_writer_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "LOCK_TIMEOUT", 0.1)
    opened = open_store(str(tmp_path / "lab.db"))
    with sqlite3.connect(tmp_path / "lab.db", isolation_level=None) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match=r"cannot be used \(database is locked\)"), opened.write() as session:
            session.add(Aggregate(name="A", delivery=""))
        other.execute("ROLLBACK")
    other.close()


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
