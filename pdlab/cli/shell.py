"""What every verb has: options, the open store with its progress bar, tables, exit codes."""

import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdlab.errors import InputError, PdlabError

if TYPE_CHECKING:
    from pdlab.lab import Lab

app = typer.Typer(
    name="pdlab", help="How densely will this mixture of aggregates pack?", no_args_is_help=True,
    pretty_exceptions_enable=False, rich_markup_mode=None, add_completion=False,
)  # fmt: skip
db = typer.Typer(help="The store itself.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(db, name="db")

Store = Annotated[
    str | None, typer.Option("--store", help="Store URL or SQLite file; else PDLAB_STORE, else pdlab.db.")
]
Rule = Annotated[str, typer.Option(help="Rule for the equivalent diameter.")]
Method = Annotated[
    str,
    typer.Option(
        help="monosized, monosized_rolling, graded, or auto: the first that reaches the density; or repose, by the "
        "angle of repose."
    ),
]
MethodOrReference = Annotated[
    str,
    typer.Option(
        help="monosized, monosized_rolling, graded, or auto: the first that reaches the density; repose, by the angle "
        "of repose; or a geometric reference: static, drop_and_roll, ordered."
    ),
]
LeaveOut = Annotated[float | None, typer.Option("--leave-out", help="Leave out graded spheres finer than this [mm].")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes that simulate; all cores by default.")]
Threads = Annotated[int, typer.Option(min=1, help="Threads that share one large bed.")]


def _show_version(wanted: bool) -> None:
    if wanted:
        from pdlab import __version__

        print(f"pdlab {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_show_version)
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Log what is done to stderr.")] = False,
) -> None:
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(name)s: %(message)s")


@contextmanager
def open_lab(store: str | None, workers: int | None = None, threads: int = 1) -> Iterator["Lab"]:
    """Open the store, say when it is made, and show a bar while beds are simulated."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from pdlab.lab import Lab

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(), console=console, transient=True,
        disable=not console.is_terminal,
    )  # fmt: skip
    task = bar.add_task("", total=1.0, visible=False)

    def show(progress: Any) -> None:
        if not bar.live.is_started:
            bar.start()
        text = f"simulating: {progress.simulated} of {progress.wanted - progress.read} beds"
        if progress.beds:
            last = min(progress.beds, key=lambda bed: bed.share)
            text += f" ({last.steps} steps, kinetic energy {last.kinetic_energy:.0e} m g d)"
        bar.update(task, completed=progress.share, description=text, visible=True)
        if progress.simulated == progress.wanted - progress.read:
            bar.stop()
            bar.reset(task, visible=False)

    with Lab(store, workers, show, threads) as lab:
        if lab.store.created and lab.store.url != "sqlite://":
            print(f"made a new store: {lab.store.url}")
        try:
            yield lab
        finally:
            bar.stop()


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose first column stands left and whose others stand right."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*row)
    print_wide(table)


def print_wide(what: Any) -> None:
    """Print what rich can show, as wide as the terminal, or as 140 characters into a file."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, emoji=False, markup=False, highlight=False).print(what)


def number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    """Return a number as text, nothing for None."""
    return "" if value is None else f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def raise_failures(reports: Sequence[Any]) -> None:
    """Name every failure on stderr and end with its exit code."""
    errors = [report.error for report in reports if report.error is not None]
    for report in reports:
        if report.error is not None:
            print(f"{getattr(report, 'mixture', None) or report.aggregate}: {report.error}", file=sys.stderr)
    end_with(errors)


def end_with(errors: Sequence[PdlabError]) -> None:
    """End with the exit code of failures that were named, if there are any."""
    if errors:
        raise typer.Exit(2 if all(isinstance(error, InputError) for error in errors) else 1)


def check_writable(output: Path) -> None:
    """Raise InputError, before anything is simulated, unless a file can be written."""
    try:
        with output.open("a", encoding="utf-8"):
            pass
    except OSError as error:
        raise InputError(f"{output} cannot be written ({error.strerror}); choose another file") from error
