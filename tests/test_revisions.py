"""Migrations: equal to the models, all or nothing, and every revision that landed can be upgraded and used."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from conftest import STORES, both, check_kept

from pdlab.errors import MigrationFailed, StoreError
from pdlab.experiments import calibrate, comparisons, listed, predict, summaries
from pdlab.frames import prediction_frame
from pdlab.grading import SieveRow, SieveTable
from pdlab.models import Base
from pdlab.store import Store, copying, open_store, revisions, runs, sizes, upgrade
from pdlab.store.databases import connected, parse

MIGRATIONS = revisions.migrations()
BROKEN = """
import sqlalchemy as sa
from alembic import op

revision, down_revision, branch_labels, depends_on = "9001", "{head}", None, None


def upgrade():
    op.create_table("half", sa.Column("id", sa.Integer(), primary_key=True))
    op.drop_table("run_state")
    with op.batch_alter_table("run") as batch_op:
        batch_op.add_column(sa.Column("half", sa.Integer()))
        batch_op.alter_column("rest", new_column_name="standstill")
    op.execute("UPDATE aggregate SET name = name || '?'")
    {fault}
"""


def content(url: str) -> list[Any]:
    """All that a store holds: its revision, its columns and views, the rows and checksum of each table."""
    with connected(parse(url)) as connection:
        inspector = sa.inspect(connection)
        columns = [
            (table, column["name"], str(column["type"]))
            for table in sorted(inspector.get_table_names())
            for column in inspector.get_columns(table)
        ]
        tables = [copying.checksum(connection, table) for table in copying._reflected(connection)]
        return [copying.stamped(connection, ""), columns, sorted(inspector.get_view_names()), tables]


def loaded(old: Path, revision: str, address: str) -> str:
    """Return the URL of an old store with its rows, a SQLite file or a PostgreSQL database."""
    if address.startswith("sqlite"):
        return f"sqlite:///{old}"
    copying._copy(parse(f"sqlite:///{old}"), parse(address), revision)
    return address


def test_every_revision_has_a_store_with_rows_among_the_tests() -> None:
    missing = revisions.known_revisions() - {path.stem for path in STORES.glob("*.sql")}
    assert not missing, "run tests/data/stores/make.py"


@both
@pytest.mark.parametrize("revision", sorted(revisions.known_revisions()))
def test_a_store_of_every_revision_is_upgraded_and_used(
    revision: str, address: str, old_store: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, formula_runner: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    url = loaded(old_store(revision), revision, address)
    before, after, kept = upgrade(url)
    assert (before, after) == (revision, revisions.head())
    assert (kept is None) == (revision == revisions.head())
    store = open_store(url)
    assert [one.name for one in summaries(store)] == ["pebbles L", "pebbles M", "pebbles F"]
    with store.read() as session:
        assert len(runs(session)) == 33
    check_kept(store)
    measured = [row[0] for row in listed(store, "predictions", columns=["measured"])[1]]
    assert measured == pytest.approx([0.642, 0.644, 0.621], abs=1e-12)
    earlier = comparisons(store)
    assert [report.state for report in earlier] == ["done"] * 3
    assert all(report.error is None for report in calibrate(store, formula_runner(store)))
    again = predict(store, formula_runner(store))
    assert [report.mixture for report in again] == [report.mixture for report in earlier]
    assert len(prediction_frame(again).to_csv().splitlines()) == 4
    store.close()


@pytest.mark.parametrize(
    ("kind", "pan_lower", "results"),
    [
        ("retained_g", None, [(16.0, 0.0), (8.0, 300.0), (4.0, 150.0), (2.0, 50.0), (None, 20.0)]),
        ("retained_g", 0.5, [(2.0, 50.0), (4.0, 150.0), (8.0, 300.0), (16.0, 0.0), (None, 200.0)]),
        ("retained_percent", None, [(31.5, 0.0), (16.0, 0.0), (8.0, 61.7), (4.0, 38.2), (2.0, 0.1), (1.0, 0.0)]),
        ("passing_percent", None, [(16.0, 100.0), (8.0, 100.0), (4.0, 31.0), (2.0, 7.0), (1.0, 3.0)]),
        ("passing_percent", 0.7, [(16.0, 100.0), (8.0, 55.0), (4.0, 31.0), (2.0, 17.0), (None, 0.0)]),
        ("passing_percent", None, [(60.96, 100.0), (40.64, 0.0)]),
    ],
)
def test_an_upgrade_works_out_the_sizes_of_sieve_analyses_as_pdlab_does(
    kind: str, pan_lower: float | None, results: list[tuple[float | None, float]]
) -> None:
    script = ScriptDirectory.from_config(revisions._config()).get_revision("0003")
    assert script is not None
    table = SieveTable(tuple(SieveRow(*row) for row in results), kind, None, pan_lower)
    wanted = sizes(table)
    names = ("finest_mm", "coarsest_mm", "log_mean_mm")
    assert script.module.sizes(kind, pan_lower, results) == pytest.approx([wanted[name] for name in names], rel=1e-12)


@both
def test_an_upgrade_makes_a_backup_of_what_was_there_first(
    address: str, old_store: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    url = loaded(old_store("0001"), "0001", address)
    there = content(url)
    kept = upgrade(url).backup
    assert kept is not None
    assert "revision-0001.20" in kept.name
    assert content(url)[0] == revisions.head()
    revision, _, views, tables = content(f"sqlite:///{kept}")
    assert [revision, views, tables] == [there[0], there[2], there[3]]


@both
@pytest.mark.parametrize(
    "fault",
    ["raise ValueError('it stops midway')", "op.execute('SELECT nonsense')", "op.execute('DELETE FROM mixture')"],
    ids=["raises", "wrong statement", "rows without parents"],
)
def test_a_migration_that_fails_midway_leaves_the_store_as_it_was(
    fault: str, address: str, old_store: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    newest = revisions.head()
    url = loaded(old_store(newest), newest, address)
    there = content(url)
    folder = tmp_path / "migrations"
    shutil.copytree(MIGRATIONS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "versions" / "9001_broken.py").write_text(BROKEN.format(head=newest, fault=fault))
    monkeypatch.setattr(revisions, "migrations", lambda: folder)
    with pytest.raises(MigrationFailed, match=rf"from revision {newest} to 9001 failed .* is as it was.*backup"):
        upgrade(url)
    assert content(url) == there
    monkeypatch.setattr(revisions, "migrations", lambda: MIGRATIONS)
    open_store(url).close()


def test_an_upgrade_whose_backup_cannot_be_written_changes_nothing(
    old_store: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"sqlite:///{old_store('0001')}"
    there = content(url)
    full = StoreError("the disk is full; make room")
    monkeypatch.setattr("pdlab.store.opening.write_backup", lambda *_: (_ for _ in ()).throw(full))
    with pytest.raises(StoreError, match="the disk is full"):
        upgrade(url)
    assert content(url) == there


@both
def test_upgrade_makes_a_store_once(address: str) -> None:
    assert upgrade(address) == (None, revisions.head(), None)
    assert upgrade(address) == (revisions.head(), revisions.head(), None)


@both
@pytest.mark.parametrize(
    ("revision", "message"),
    [("9999", "is a store of revision 9999, newer than .*; install a newer pdlab"),
     ("0000", "is a store of revision 0000, older than .*; run 'pdlab db upgrade'")],
)  # fmt: skip
def test_a_store_of_another_revision_says_what_to_do(
    address: str, revision: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_store(address).close()
    with connected(parse(address), writing=True) as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = :number"), {"number": revision})
    if revision == "0000":
        monkeypatch.setattr(revisions, "known_revisions", lambda: {"0000", "0001"})
    calls: list[Callable[[str], Any]] = [open_store, lambda url: copying.copy(url, "copy.db")]
    for call in calls if revision == "0000" else [*calls, upgrade]:
        with pytest.raises(StoreError, match=message):
            call(address)


def test_models_equal_migrations(store: Store) -> None:
    assert isinstance(store.writer, sa.Connection)
    assert compare_metadata(MigrationContext.configure(store.writer), Base.metadata) == []


def checks(connection: sa.Connection, schema: str | None = None) -> dict[str, dict[str | None, str]]:
    """The CHECK constraints as the database has them, by table and name."""
    inspector = sa.inspect(connection)
    return {
        table: {check["name"]: check["sqltext"] for check in inspector.get_check_constraints(table, schema)}
        for table in Base.metadata.tables
    }


def test_checks_equal_migrations_to_the_letter(store: Store) -> None:
    assert isinstance(store.writer, sa.Connection)
    made = checks(store.writer)
    assert any(made.values())
    if store.writer.dialect.name == "sqlite":
        with sa.create_engine("sqlite://").begin() as fresh:
            Base.metadata.create_all(fresh)
            assert checks(fresh) == made
        fresh.engine.dispose()
    else:
        store.writer.exec_driver_sql("CREATE SCHEMA models")
        Base.metadata.create_all(store.writer.execution_options(schema_translate_map={None: "models"}))
        assert checks(store.writer, "models") == made
        store.writer.execution_options(schema_translate_map=None)
