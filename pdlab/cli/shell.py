"""What every verb has: options, the open store with its progress bar, tables, exit codes."""

import logging
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdlab.errors import InputError, PdlabError

if TYPE_CHECKING:
    from pdlab.batch.progress import Progress
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
Seeds = Annotated[int, typer.Option(min=2, help="Beds at each node of the curve, and of each mixture at first.")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes that simulate; all cores by default.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Simulate on a cluster: tcp://HOST:PORT of its dask scheduler; needs pdlab[cluster]."),
]
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


class Bar:
    """The bar on a terminal while beds are simulated; of a table, by the ``mixtures`` and sphere-steps of its plan."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"),
            TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(), console=console, transient=True,
            disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("", total=1.0, visible=False)
        self.mixtures, self.sphere_steps, self.rows = 0, 0.0, 0

    def show(self, progress: "Progress") -> None:
        """Show how far a call is."""
        if not self._bar.live.is_started:
            self._bar.start()
        beds, share = f"{progress.simulated} of {progress.wanted - progress.read} beds", progress.share
        if self.mixtures:
            text = f"predicting: {self.rows} of {self.mixtures} mixtures, {progress.simulated} beds"
            share = min(0.999, progress.sphere_steps / max(self.sphere_steps, 1.0))
        elif progress.beds:
            last = min(progress.beds, key=lambda bed: bed.share)
            text = f"simulating: {beds} ({last.steps} steps, kinetic energy {last.kinetic_energy:.0e} m g d)"
        else:
            text = f"simulating: {beds}"
        self._bar.update(self._task, completed=share, description=text, visible=True)
        if not self.mixtures and progress.simulated == progress.wanted - progress.read:
            self.hide()

    def hide(self) -> None:
        """Take the bar away until there is more to show."""
        self._bar.stop()
        self._bar.reset(self._task, visible=False)


@contextmanager
def open_lab(
    store: str | None,
    workers: int | None = None,
    threads: int = 1,
    scheduler: str | None = None,
    bar: Bar | None = None,
) -> Iterator["Lab"]:
    """Open the store, say when it is made, and show a bar while beds are simulated."""
    from pdlab.experiments import damage_named
    from pdlab.lab import Lab

    bar = bar or Bar()
    with Lab(store, workers, bar.show, threads, scheduler) as lab:
        if lab.store.created and lab.store.url != "sqlite://":
            print(f"made a new store: {lab.store.url}")
        try:
            with damage_named(lab.store):
                yield lab
        finally:
            bar.hide()


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


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.2g} s"


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


def end_as_by_ctrl_c() -> None:
    """Take SIGTERM, and the SIGHUP of a terminal that is closed, as Ctrl-C, once: none comes between while all ends.

    A hang-up that is ignored stays so: who starts a process by nohup wants it kept.
    """
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    heard = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]

    def stop(*_: object) -> None:
        for number in heard:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in heard:
        signal.signal(number, stop)
