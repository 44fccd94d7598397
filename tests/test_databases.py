"""Addresses, engines and the sentences for what cannot be opened; no password in any of them."""

import logging
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import sqlalchemy as sa
from conftest import both, execute

from pdlab import cli
from pdlab.errors import StoreError
from pdlab.models import Aggregate
from pdlab.store import Store, backup, copy, databases, open_store, upgrade

CANARY = "Zeisig7"


@pytest.fixture(scope="session")
def locked(server: sa.URL) -> sa.URL:
    """A database that asks its user for a password."""
    engine = sa.create_engine(server)
    with engine.connect() as connection:
        rules = Path(connection.exec_driver_sql("SHOW hba_file").scalar_one())
    engine.dispose()
    execute(server, f"CREATE ROLE finch LOGIN PASSWORD '{CANARY}'")
    execute(server, "CREATE DATABASE aviary OWNER finch")
    rules.write_text(f"local all finch scram-sha-256\n{rules.read_text()}")
    execute(server, "SELECT pg_reload_conf()")
    return server.set(username="finch", password=CANARY, database="aviary")


def plain(url: sa.URL) -> str:
    return url.render_as_string(hide_password=False)


@contextmanager
def without_a_password(capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Whatever is printed or logged, down to the last detail, holds no canary."""
    for name in (None, "sqlalchemy", "alembic", "psycopg", "pdlab"):
        caplog.set_level(logging.DEBUG, name)
    yield
    printed = capsys.readouterr()
    assert CANARY not in printed.out + printed.err + caplog.text


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    monkeypatch.setattr(sys, "argv", ["pdlab", "-v", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


def test_no_verb_prints_or_logs_the_password(
    locked: sa.URL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    url = plain(locked)
    with without_a_password(capsys, caplog):
        assert run(monkeypatch, "ls", "--store", url) == 0
        assert run(monkeypatch, "db", "upgrade", "--store", url.replace(f":{CANARY}", "") + f"&password={CANARY}") == 0
        assert run(monkeypatch, "db", "upgrade", "--store", url) == 0
        assert run(monkeypatch, "db", "backup", "kept.db", "--store", url) == 0
        assert run(monkeypatch, "db", "copy", "kept.db", url) == 0
        assert run(monkeypatch, "db", "copy", url, "kept.db") == 0
        assert "finch:***@" in capsys.readouterr().out
        store = open_store(url)
        print(repr(store), str(store), store.url)
        store.close()


def changed(url: sa.URL, **parts: str) -> str:
    return plain(url.set(**parts))  # type: ignore[arg-type]


WRONG: dict[str, tuple[Callable[[sa.URL], str], str]] = {
    "password": (lambda url: changed(url, password=f"x{CANARY}"), "authentication failed .*; correct the user or"),
    "no password": (lambda url: plain(url).replace(f":{CANARY}", ""), "no password supplied.*; give the password in"),
    "user": (lambda url: changed(url, username="nobody"), '"nobody" does not exist.*; correct the user'),
    "database": (lambda url: changed(url, database="cage"), '"cage" does not exist.*; create it with createdb'),
    "socket": (lambda url: plain(url.set(query={"host": "/nowhere"})), "No such file .*; start the server"),
    "option": (lambda url: plain(url) + "&nonsense=1", "invalid connection option .*; correct what stands behind"),
    "host": (lambda _: f"postgresql://finch:{CANARY}@no-such-host.invalid/aviary", "resolve host.*; correct the host"),
    "port": (lambda _: f"postgresql://finch:{CANARY}@127.0.0.1:1/aviary", "refused.*; start the server"),
    "at sign": (lambda _: f"postgresql://finch:a@{CANARY}@host/aviary", "more than one '@'; write .* as %40"),
    "no at sign": (lambda _: f"postgresql://finch:{CANARY}", "'postgresql:...' is no store address; write"),
    "scheme": (lambda _: f"postgres://finch:{CANARY}@host/aviary", "'postgres' stores cannot be opened .*; write"),
    "dialect": (lambda _: f"oracle://finch:{CANARY}@host/aviary", "'oracle' stores cannot be opened .*; write"),
    "driver": (lambda _: f"postgresql+asyncpg://finch:{CANARY}@h/a", "asyncpg' stores cannot be opened .*; write"),
    "no scheme": (lambda _: f"finch:{CANARY}@host/aviary", "is no store address; write"),
    "key": (lambda url: plain(url.set(password="x")) + f"&sslpassword={CANARY}", "authentication failed"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_with_an_address_is_a_sentence_without_the_password(
    wrong: str, locked: sa.URL, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    make, message = WRONG[wrong]
    url = make(locked)
    with without_a_password(capsys, caplog):
        for call in (open_store, upgrade, lambda url: backup(url, tmp_path / "b.db"), lambda url: copy(url, "b.db")):
            with pytest.raises(StoreError, match=message) as caught:
                call(url)
            assert CANARY not in "".join(traceback.format_exception(caught.value))
            assert "\n" not in str(caught.value)
        assert run(monkeypatch, "ls", "--store", url) == 2
    assert not list(tmp_path.iterdir())


def test_postgresql_without_its_driver_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreError, match=r"driver that is not installed .*pip install 'pdlab\[postgres\]'"):
        open_store("postgresql://finch@host/aviary")


def test_importing_the_store_needs_no_driver() -> None:
    code = "import sys; sys.modules['psycopg'] = None; import pdlab.store, pdlab.lab; print('fine')"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stdout == "fine\n", done.stderr


def test_a_database_of_another_program_is_refused_and_left_as_it_was(new_database: Callable[[], str]) -> None:
    url = sa.make_url(new_database())
    execute(url, "CREATE TABLE music (title text)")
    for call in (open_store, upgrade, lambda url: copy("sqlite:///none.db", url)):
        with pytest.raises(StoreError, match=r"holds other tables \(music\)|holds no store yet"):
            call(plain(url))
    with databases.connected(url) as connection:
        assert sa.inspect(connection).get_table_names() == ["music"]


MOUNTS = r"""22 1 8:1 / / rw,relatime - ext4 /dev/sda1 rw
30 22 0:40 / /mnt/lab\040share rw - autofs systemd-1 rw
31 30 0:41 / /mnt/lab\040share rw shared:5 - {kind} //server/share rw
32 31 8:2 / /mnt/lab\040share/local rw - xfs /dev/sdb rw
"""


@pytest.mark.parametrize("kind", ["nfs4", "cifs", "9p", "fuse.sshfs"])
def test_a_network_drive_is_refused_and_points_to_postgresql(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "mountinfo"
    table.write_text(MOUNTS.format(kind=kind))
    monkeypatch.setattr(databases, "MOUNTS", table)
    with pytest.raises(StoreError, match=rf"network drive \({kind}\).*PostgreSQL store for several machines"):
        databases.refuse_network_drive(Path("/mnt/lab share/store/lab.db"))
    databases.refuse_network_drive(Path("/mnt/lab share/local/lab.db"))
    databases.refuse_network_drive(Path("/mnt/lab shares.db"))
    table.write_text(f"22 1 0:9 / / rw - {kind} server:/ rw\n")
    for call in (open_store, upgrade, lambda path: copy(path, "copy.db")):
        with pytest.raises(StoreError, match="lies on a network drive"):
            call(str(tmp_path / "lab.db"))
    assert not (tmp_path / "lab.db").exists()


def test_where_no_mounts_are_told_a_file_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(databases, "MOUNTS", tmp_path / "none")
    open_store(str(tmp_path / "lab.db")).close()


@pytest.fixture
def folder_of_others() -> Iterator[Path]:
    """A folder that this user may read, and no more; root goes on as a user without rights."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        open_store(str(folder / "lab.db")).close()
        (folder / "closed").mkdir()
        (folder / "closed").chmod(0)
        folder.chmod(0o555)
        root = os.geteuid() == 0
        if root:
            os.seteuid(65534)
        yield folder
        if root:
            os.seteuid(0)
        folder.chmod(0o755)
        (folder / "closed").chmod(0o755)


def test_what_permissions_forbid_is_a_sentence_and_changes_nothing(folder_of_others: Path) -> None:
    refused = r"cannot be used \(.*\); allow reading and writing it"
    with pytest.raises(StoreError, match=refused):
        open_store(str(folder_of_others / "lab.db"))
    with pytest.raises(StoreError, match=refused):
        upgrade(str(folder_of_others / "new.db"))
    with pytest.raises(StoreError, match=r"cannot be opened \(Permission denied\); choose another --store"):
        open_store(str(folder_of_others / "closed" / "lab.db"))
    with tempfile.TemporaryDirectory() as own:
        open_store(f"{own}/lab.db").close()
        for call in (lambda file: backup(f"{own}/lab.db", file), lambda file: copy(f"{own}/lab.db", str(file))):
            with pytest.raises(StoreError, match=r"cannot be written \(Permission denied\); choose another place"):
                call(folder_of_others / "copy.db")
    assert sorted(path.name for path in folder_of_others.iterdir()) == ["closed", "lab.db"]


@both
def test_a_full_disk_is_a_sentence_and_keeps_nothing(opened: Store) -> None:
    full = "DO $$ BEGIN RAISE 'could not extend file: No space left on device' USING ERRCODE = '53100'; END $$"
    message = r"cannot be used \(.*(disk is full|No space left).*\); make room on the disk"
    if "sqlite" in opened.url:
        full = "PRAGMA max_page_count = 1"  # SQLite takes it for the pages there are

    def write() -> None:
        with opened.write() as session:
            session.add(Aggregate(name="A", delivery=""))
            session.flush()
            session.connection().exec_driver_sql(full)
            session.add(Aggregate(name="B" * 100_000, delivery=""))

    with pytest.raises(StoreError, match=message):
        write()
    with opened.read() as session:
        assert session.scalar(sa.select(sa.func.count()).select_from(Aggregate)) == 0


def test_a_role_that_may_not_write_is_a_sentence(server: sa.URL, new_database: Callable[[], str]) -> None:
    url = sa.make_url(new_database())
    open_store(plain(url)).close()
    execute(url, "CREATE ROLE guest LOGIN")
    with pytest.raises(StoreError, match=r"permission denied.*; allow reading and writing it"):
        open_store(changed(url, username="guest"))
    execute(url, "GRANT SELECT ON ALL TABLES IN SCHEMA public TO guest")
    store = open_store(changed(url, username="guest"))
    refused = pytest.raises(StoreError, match=r"permission denied.*; allow reading and writing it")
    with refused, store.write() as session:
        session.add(Aggregate(name="A", delivery=""))
    store.close()
