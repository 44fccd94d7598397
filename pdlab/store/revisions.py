"""The migrations, and which of them a store has had."""

from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory

from pdlab.errors import StoreError
from pdlab.store.databases import connected, is_sqlite, refuse_network_drive, shown


def migrations() -> Path:
    """Return the folder of the migrations: it lies in the package, in a checkout beside it."""
    package = Path(__file__).parent.parent
    return next(place / "migrations" for place in (package, package.parent) if (place / "migrations").is_dir())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(migrations()).replace("%", "%%"))
    return config


def migrate(bind: sa.Engine | sa.Connection, revision: str = "head") -> None:
    """Run the migrations on an engine, in one transaction, or on a connection within its own."""
    if isinstance(bind, sa.Engine):
        with bind.begin() as connection:
            migrate(connection, revision)
        return
    config = _config()
    config.attributes["connection"] = bind
    command.upgrade(config, revision)


def head() -> str:
    """Return the newest revision of this pdlab."""
    newest = ScriptDirectory.from_config(_config()).get_current_head()
    assert newest is not None, "the package lost its migrations"
    return newest


def known_revisions() -> set[str]:
    """Return the revisions that this pdlab can upgrade."""
    return {script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()}


def revision_of(url: sa.URL) -> str | None:
    """Return the revision of a store, None where there is none yet.

    Raises StoreError where there cannot be one, or where something else stands.
    """
    if is_sqlite(url) and not _file_exists(Path(url.database or "")):
        return None
    with connected(url) as connection:
        return stamped(connection, shown(url))


def stamped(connection: sa.Connection, name: str) -> str | None:
    """Return the revision of the store on a connection, None where the database is empty.

    Raises StoreError where the tables are another program's; ``name``: what it calls the store.
    """
    names = set(sa.inspect(connection).get_table_names())
    if not names:
        return None
    query = "SELECT version_num FROM alembic_version"
    rows = connection.exec_driver_sql(query).all() if "alembic_version" in names else []
    if len(rows) == 1 and names >= {"aggregate", "mixture", "run"}:
        return str(rows[0][0])
    raise StoreError(
        f"{name} holds other tables ({', '.join(sorted(names)[:3])}), no pdlab store; choose another with --store"
    )


def _file_exists(path: Path) -> bool:
    """Tell whether a SQLite file is there. Raises StoreError where it could not be."""
    try:
        if path.is_dir():
            raise StoreError(f"{path} is a folder, no pdlab store; choose a file with --store")
        if not path.parent.is_dir():
            raise StoreError(f"the folder of {path} does not exist; make it or choose another --store")
        refuse_network_drive(path)
        return path.exists()
    except OSError as error:
        raise StoreError(f"{path} cannot be opened ({error.strerror}); choose another --store") from error


def check_revision(url: sa.URL, revision: str, older_is_fine: bool = False) -> None:
    """Raise StoreError for a store of a newer revision, or of an older one unless that ``is fine``."""
    if revision not in known_revisions():
        raise StoreError(
            f"{shown(url)} is a store of revision {revision}, newer than the {head()} of this pdlab; "
            "install a newer pdlab"
        )
    if revision != head() and not older_is_fine:
        raise StoreError(
            f"{shown(url)} is a store of revision {revision}, older than the {head()} of this pdlab; "
            "run 'pdlab db upgrade'"
        )
