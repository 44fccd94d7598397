"""The store itself."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import Store, print_table

if TYPE_CHECKING:
    pass


def upgrade(store: Store = None) -> None:
    """Bring the store to this version's tables after a backup, making it when it is missing."""
    from pdlab.store import shown_url
    from pdlab.store import upgrade as run

    before, after, kept = run(store)
    if kept is not None:
        print(f"backup of revision {before}: {kept}")
    done = "made" if before is None else "upgraded" if before != after else "already"
    print(f"{shown_url(store)}: {done} at revision {after}")


def backup(file: Path, store: Store = None) -> None:
    """Write the store into a new SQLite FILE, checked afterwards; others may write on meanwhile."""
    from pdlab.store import backup as run
    from pdlab.store import shown_url

    revision = run(store, file)
    size = file.stat().st_size / 1e6
    print(f"backup of {shown_url(store)} at revision {revision}: {file} ({size:.2f} MB, checked)")


def copy(
    source: Annotated[str, typer.Argument(metavar="FROM", help="Store URL or SQLite file.")],
    target: Annotated[str, typer.Argument(metavar="TO", help="An empty database's URL, or a new SQLite file.")],
) -> None:
    """Copy a store to another database, SQLite or PostgreSQL, and compare: all of it or nothing."""
    from pdlab.store import copy as run
    from pdlab.store import shown_url

    tables = run(source, target)
    rows = [[table.name, str(table.rows), table.checksum[:12]] for table in tables]
    print_table("Copied, equal on both sides", ["table", "rows", "SHA-256"], rows)
    print(f"{sum(table.rows for table in tables)} rows from {shown_url(source)} to {shown_url(target)}")
