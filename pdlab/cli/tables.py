"""Tables in and out, and lists of what is there."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdlab.cli.shell import Store, check_writable, open_lab, print_table
from pdlab.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

LISTS = ("aggregates", "mixtures", "runs", "predictions", "corrections")
PAGE = 30
"""Rows of a list in the terminal, where no other number is asked for."""
LONGEST_BEFORE = 40


def import_(
    path: Annotated[Path, typer.Argument(metavar="FILE-OR-FOLDER")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be new; write nothing.")] = False,
    store: Store = None,
) -> None:
    """Import aggregates, sieves, density tests and mixtures from CSV or .xlsx: all of it or nothing."""
    from pdlab.store import is_made, shown_url

    made = not dry_run or is_made(store)  # a dry run beside no store looks at one in memory
    with open_lab(store if made else "sqlite://") as lab:
        done = lab.import_tables(path, dry_run)
    new = ", ".join(f"{count} {name}" for name, count in done.new.items() if count) or "nothing new"
    if dry_run:
        for (table, is_new), names in done.names.items():
            shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
            print(f"{'new' if is_new else 'equal'}: {table}: {shown}")
    if not made:
        print(f"there is no store yet; {shown_url(store)} would be made")
    for note in done.notes:
        print(f"note: {note}")
    print(f"{'would import' if dry_run else 'imported'} {new}; {done.equal} equal to what was there")


def export(
    path: Annotated[Path, typer.Argument(metavar="FOLDER-OR-FILE.xlsx", help="New; nothing is overwritten.")],
    store: Store = None,
) -> None:
    """Write all aggregates, sieves, density tests and mixtures as the tables that import reads."""
    with open_lab(store) as lab:
        done = lab.export_tables(path)
    for note in done.notes:
        print(f"note: {note}")
    print(f"written to {path}: {', '.join(f'{count} rows of {table}' for table, count in done.rows.items())}")


def ls(
    what: Annotated[str, typer.Argument(help=" | ".join(LISTS))] = "aggregates",
    conditions: Annotated[
        list[str] | None, typer.Argument(help="Such as 'packing_density>0.6'; also = != < <= >= and ~ (contains).")
    ] = None,
    columns: Annotated[str, typer.Option(help="Columns, a comma between them.")] = "",
    sort: Annotated[str, typer.Option(help="Columns to sort by, a minus before one whose values fall.")] = "",
    limit: Annotated[int | None, typer.Option(min=1, help=f"Most rows; {PAGE} in the terminal, all in a file.")] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the list as CSV.")] = None,
    store: Store = None,
) -> None:
    """List what the store holds, where all conditions are met."""
    if what not in LISTS:
        raise InputError(f"'{what}' cannot be listed; use one of {', '.join(LISTS)}")
    asked = [name.strip() for name in columns.split(",") if name.strip()]
    where = conditions or []
    if output is not None:
        check_writable(output)
    with open_lab(store) as lab:
        if csv or output is not None:
            frame = getattr(lab, what)(where, asked, sort, limit)
            frame.to_csv(output or sys.stdout, index=False)
            if output is not None:
                print(f"written to {output}")
            return
        frame = getattr(lab, what)(where, asked, sort, limit or PAGE)
        if frame.empty:
            print(f"no {what} " + ("meet these conditions" if where and lab.count(what) else "yet"))
            return
        in_all = lab.count(what, where) if len(frame) == (limit or PAGE) else len(frame)
        _show_list(frame, what, in_all, asked)


def _show_list(frame: "DataFrame", what: str, in_all: int, asked: Sequence[str]) -> None:
    """Print a page of a list, its messages below it where they are not asked for as a column."""
    notes = list(frame.pop("message").fillna("")) if "message" in frame and not asked else []
    names = list(frame.iloc[:, 0])
    if not asked:
        frame = frame.drop(columns=frame.columns[(frame.isna() | (frame == "")).all()])
    cells = [
        [_cell(*cell) for cell in zip(frame.columns, row, strict=True)]
        for row in frame.itertuples(index=False, name=None)
    ]
    print_table(f"{len(frame)} {what}" if what != "mixtures" else what, list(frame.columns), cells)
    if in_all > len(frame):
        print(f"the first {len(frame)} of {in_all} rows; more with --limit, all with --csv or -o FILE")
    together: dict[str, list[str]] = {}
    for name, note in zip(names, notes, strict=False):
        if note:
            together.setdefault(note, []).append(name)
    for note, said in together.items():
        print(f"note: {', '.join(said)}: {note}")


def _cell(column: str, value: Any) -> str:
    import pandas as pd

    if pd.isna(value):
        return ""
    if column == "specimen_hash":
        return str(value)[:12]
    if isinstance(value, pd.Timestamp):
        return f"{value:%Y-%m-%d %H:%M}"
    if column == "before" and len(str(value)) > LONGEST_BEFORE:  # a whole row that was deleted
        return f"{str(value)[:LONGEST_BEFORE]}..."
    return f"{value:.5g}" if isinstance(value, float) else str(value)
