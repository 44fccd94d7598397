"""Backups of a live store, and copies between the databases: of one moment, equal, all or nothing."""

import datetime as dt
import itertools
import math
import shutil
import sqlite3
import subprocess
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from conftest import both

from pdlab import Lab
from pdlab.errors import StoreError
from pdlab.models import Aggregate, Correction, Mixture, Run, RunState, SieveAnalysis
from pdlab.store import Store, aggregates, backup, copy, copying, open_store, revisions
from pdlab.store.databases import connected, parse


def sums(url: str) -> list[copying.TableCopy]:
    with connected(parse(url)) as connection:
        return [copying.checksum(connection, table) for table in copying._reflected(connection)]


def fill(store: Store) -> None:
    """Rows that two databases could take for different ones."""
    moment = dt.datetime(2026, 2, 28, 23, 59, 59, 1, tzinfo=dt.timezone(dt.timedelta(hours=5)))
    with store.write() as session:
        session.add_all(
            [
                Aggregate(
                    name="Ä μ 砂 \\ ' \" | \n", delivery="", shape="", wall_angle_deg=-0.0, repose_angle_deg=1e300
                ),
                Aggregate(name="zz", delivery="é", wall_angle_deg=0.1 + 0.2, repose_angle_deg=5e-324),
                Aggregate(name="zz", delivery="É", wall_angle_deg=math.inf, created_at=moment),
                Aggregate(name="zz", delivery="e", wall_angle_deg=3.0),
            ]
        )
        session.flush()
        session.add(SieveAnalysis(aggregate_id=1, kind="retained_g", date=dt.date(1908, 1, 2)))
        session.add(Correction(table_name="mixture", row_key="1/2", column_name="name", corrected_by="K."))
        for k in range(250):  # more than two batches
            digest = f"{k * 7919 % 251:064x}"
            session.add(Run(specimen_hash=digest, specimen="{}", engine_version=1, seed=k, spheres=1, state="queued"))
        session.flush()
        session.add(RunState(specimen_hash=f"{0:064x}", steps=1, archive=bytes(range(256)) * 100))


def test_a_store_goes_to_postgresql_and_back_with_equal_checksums(
    tmp_path: Path, new_database: Callable[[], str]
) -> None:
    origin, middle, back = str(tmp_path / "origin.db"), new_database(), str(tmp_path / "back.db")
    fill(store := open_store(origin))
    store.close()
    there = copy(origin, middle)
    assert copy(middle, back) == there
    assert sums(f"sqlite:///{back}") == sums(middle) == sums(f"sqlite:///{origin}") == there
    assert {table.name: table.rows for table in there}["run"] == 250
    store = open_store(middle)
    with store.write() as session:  # the key after the last, in the copied tables and in the empty ones
        session.add_all([Aggregate(name="new", delivery="", wall_angle_deg=-0.0), Mixture(name="first")])
        session.flush()
        assert session.scalars(sa.select(sa.func.max(Aggregate.id))).one() == 5
        assert session.scalars(sa.select(Mixture.id)).one() == 1
    with store.read() as session:
        first = session.get_one(Aggregate, 1)
        assert first.name == "Ä μ 砂 \\ ' \" | \n"
        moment = session.get_one(Aggregate, 3).created_at
        assert moment == dt.datetime(2026, 2, 28, 18, 59, 59, 1, tzinfo=dt.UTC)
        assert session.get_one(RunState, f"{0:064x}").archive == bytes(range(256)) * 100
    store.close()
    assert copy(middle, tmp_path / "third.db") == sums(middle)  # SQLite keeps no negative zero


def test_a_checksum_tells_rows_apart_that_differ_in_one_value(tmp_path: Path) -> None:
    fill(store := open_store(str(tmp_path / "lab.db")))
    url, seen = store.url, []
    for change in (
        "UPDATE aggregate SET shape = NULL WHERE id = 1", "UPDATE aggregate SET wall_angle_deg = 0.3 WHERE id = 2",
        "UPDATE aggregate SET shape = 'None' WHERE id = 1", "UPDATE run_state SET archive = x'00'",
        "UPDATE aggregate SET created_at = '2026-02-28 18:59:59.000002' WHERE id = 3", "DELETE FROM correction",
    ):  # fmt: skip
        seen.append(sums(url))
        with store.write() as session:
            session.connection().exec_driver_sql(change)
    assert all(before != after for before, after in zip(seen, [*seen[1:], sums(url)], strict=True))
    store.close()


@both
def test_a_copy_never_overwrites_and_takes_a_store_without_rows(address: str, tmp_path: Path, old_store: Any) -> None:
    origin = str(old_store(revisions.head()))
    open_store(address).close()  # made, and still without rows
    there = copy(origin, address)
    assert sum(table.rows for table in there) > 100
    with pytest.raises(StoreError, match="holds a store already and is not overwritten; copy into an empty"):
        copy(origin, address)
    with pytest.raises(StoreError, match="holds a store already"):
        copy(address, address)
    assert sums(address) == there


@pytest.mark.parametrize(
    "row",
    [
        Aggregate(name="A\0B", delivery=""),
        Aggregate(name="A", delivery="", density_basis="ssd"),
        Run(specimen_hash="f" * 64, specimen="{}", engine_version=2**40, seed=1, spheres=1, state="queued"),
    ],
    ids=["a character that PostgreSQL has not", "a broken rule", "a number out of range"],
)
def test_a_copy_that_fails_keeps_nothing(row: Any, tmp_path: Path, new_database: Callable[[], str]) -> None:
    origin, target = str(tmp_path / "origin.db"), new_database()
    fill(store := open_store(origin))
    with store.write() as session:
        session.connection().exec_driver_sql("PRAGMA ignore_check_constraints = ON")
        session.add(row)
        session.flush()
    store.close()
    with pytest.raises(StoreError, match=f"table {row.__tablename__} cannot be copied to .*; make room there, or corr"):
        copy(origin, target)
    assert revisions.revision_of(parse(target)) is None


@both
def test_a_copy_that_differs_is_undone(
    address: str, tmp_path: Path, old_store: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    origin = str(old_store(revisions.head()))
    seen = itertools.count()
    monkeypatch.setattr(copying, "_canonical", lambda _: str(next(seen)))
    with pytest.raises(StoreError, match=r"the copy of table \w+ differs .* and was undone"):
        copy(origin, address)
    monkeypatch.undo()
    assert revisions.revision_of(parse(address)) is None
    assert not (tmp_path / "lab.db").exists()


def test_the_memory_of_a_copy_does_not_grow_with_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copying, "BATCH", 5)
    store = open_store(str(tmp_path / "lab.db"))
    with store.write() as session:
        for k in range(120):
            session.add(
                Run(specimen_hash=f"{k:064x}", specimen="{}", engine_version=1, seed=1, spheres=1, state="queued")
            )
            session.flush()
            session.add(RunState(specimen_hash=f"{k:064x}", steps=1, archive=bytes(200_000)))
            session.flush()
            session.expunge_all()
    store.close()
    tracemalloc.start()
    copy(str(tmp_path / "lab.db"), str(tmp_path / "copy.db"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8e6, f"{peak / 1e6:.1f} MB for 24 MB of beds"


@pytest.fixture
def busy(opened: Store) -> Iterator[Store]:
    """A store that another thread writes to: an aggregate and a mixture of the same number, together."""
    done, wrote = threading.Event(), threading.Event()

    def write() -> None:
        k = 0
        while not done.is_set():
            with opened.write() as session:
                session.add(Aggregate(name=str(k), delivery=""))
                session.flush()
                session.add(Mixture(name=str(k)))
            k += 1
            wrote.set()

    thread = threading.Thread(target=write)
    thread.start()
    wrote.wait(30)
    yield opened
    done.set()
    thread.join()


@both
def test_a_backup_of_a_live_store_is_of_one_moment_and_a_store_itself(
    address: str, busy: Store, tmp_path: Path
) -> None:
    kept = [tmp_path / f"{k}.backup" for k in range(5)]
    counts = []
    for file in kept:
        assert backup(address, file) == revisions.head()
        store = open_store(str(file))
        with store.read() as session:
            pair = [session.scalar(sa.select(sa.func.count()).select_from(table)) for table in (Aggregate, Mixture)]
        store.close()
        assert pair[0] == pair[1]
        counts.append(pair[0] or 0)
    assert 0 < counts[0] < counts[-1]
    assert sorted(path.name for path in tmp_path.glob("*.backup*")) == [file.name for file in kept]


def test_a_backup_overwrites_nothing_and_names_what_is_wrong(tmp_path: Path, opened: Store) -> None:
    (tmp_path / "there").write_text("mine")
    with pytest.raises(StoreError, match="there is there already and is not overwritten; choose another name"):
        backup(opened.url, tmp_path / "there")
    assert (tmp_path / "there").read_text() == "mine"
    with pytest.raises(StoreError, match=r"cannot be written \(No such file or directory\); choose another place"):
        backup(opened.url, tmp_path / "gone" / "there")
    with pytest.raises(StoreError, match=r"none\.db holds no store yet; name the one that you mean"):
        backup(str(tmp_path / "none.db"), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_backup_that_is_not_sound_is_refused(tmp_path: Path, opened: Store) -> None:
    opened.close()
    with closing(sqlite3.connect(tmp_path / "lab.db")) as connection:
        connection.execute("INSERT INTO run_state VALUES ('no run', 1, x'00')")
        connection.commit()
    with pytest.raises(StoreError, match=r"is not sound \(a row of run_state without its run\).*put an older backup"):
        backup(opened.url, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_backup_onto_a_full_disk_leaves_no_file(tmp_path: Path, opened: Store) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mount = shutil.which("mount")
    size = ["-t", "tmpfs", "-o", "size=64k", "none", str(small)]
    if mount is None or subprocess.run([mount, *size], check=False, capture_output=True).returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        for call in (lambda: backup(opened.url, small / "b.db"), lambda: copy(opened.url, str(small / "b.db"))):
            with pytest.raises(StoreError, match=r"disk is full.*make room"):
                call()
            assert not list(small.iterdir())
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_the_names_of_a_copy_read_as_they_were_written(tmp_path: Path, old_store: Any) -> None:
    copy(str(old_store(revisions.head())), str(tmp_path / "copy.db"))
    store = open_store(str(tmp_path / "copy.db"))
    with store.read() as session:
        assert [row.name for row in aggregates(session)] == ["pebbles L", "pebbles M", "pebbles F"]
    store.close()


@both
def test_lab_backs_up_and_copies_its_store(address: str, tmp_path: Path) -> None:
    with Lab(address) as lab:
        fill(lab.store)
        lab.backup(tmp_path / "kept.db")
        copied = lab.copy(tmp_path / "copy.db")
        with pytest.raises(StoreError, match="is there already"):
            lab.backup(tmp_path / "kept.db")
    for name in ("kept.db", "copy.db"):
        assert sums(f"sqlite:///{tmp_path / name}") == sums(address)
    assert dict(zip(copied["name"], copied["rows"], strict=True))["run"] == 250
