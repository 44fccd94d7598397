"""Where a number comes from, and how it is put right."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import Store, Workers, end_with, number, open_lab, print_table, print_wide
from pdlab.errors import InputError
from pdlab.quantities import heading

if TYPE_CHECKING:
    from pdlab.experiments import Verified
    from pdlab.lab import Lab


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

    with open_lab(store) as lab:
        facts = lab.show(what)
        if as_json:
            print(json.dumps(facts, indent=2, ensure_ascii=False))
        else:
            print_wide(draw(facts))


def report(
    what: Annotated[str, typer.Argument(metavar="NAME-OR-ID", help="A mixture or an aggregate, as mixture:M.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="New; nothing is overwritten.")],
    method: Annotated[
        str | None, typer.Option(help="The mixture's prediction by this method; by default the last one.")
    ] = None,
    store: Store = None,
) -> None:
    """Write a lab report to print and sign: inputs, curves, prediction with its errors, descent, versions."""
    with open_lab(store) as lab:
        lab.report(what, output, method)
    print(f"written to {output}")


def verify(
    sample: Annotated[int | None, typer.Option(min=1, help="So many runs, drawn by --seed; all by default.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the draw; by default one is drawn and printed.")] = None,
    store: Store = None,
    workers: Workers = None,
) -> None:
    """Repeat stored runs and compare: to the bit on this machine's like. Changes nothing in the store."""
    import random

    seed = random.randrange(10**6) if seed is None else seed
    with open_lab(store, workers) as lab:
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
        [one.specimen_hash[:12], one.verdict, heading(one.quantity), number(one.stored, 5), number(one.repeated, 5),
         number(one.allowed, 5), one.message]
        for one in found
        if one.repeated is not None or one.verdict == "differs"
    ]  # fmt: skip
    if rows:
        columns = ["run", "verdict", "of", "stored", "repeated", "difference allowed", "note"]
        print_table("Stored runs, repeated", columns, rows)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(one.verdict for one in found).items())
    print(f"{len(found)} runs: {counts}" if found else "no runs yet")


def refresh(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    store: Store = None,
    workers: Workers = None,
) -> None:
    """Calibrate and predict again what rests on an older engine, and print the difference."""
    with open_lab(store, workers) as lab:
        found = lab.refresh(mixtures or ())
        version = lab.runner.engine_version
    if not found:
        print(f"nothing rests on an engine older than version {version}")
        return
    rows = [
        [one.label, str(one.before_version), number(one.before), number(one.after),
         number(one.difference, sign=True), number(one.standard_error)]
        for one in found
    ]  # fmt: skip
    print_table(
        f"Calibrated and predicted again by engine version {version} (aggregates: friction μ; mixtures: PD)",
        ["", "version before", "before", "after", "difference", "± simulation"],
        rows,
    )
    for one in found:
        if one.error is not None:
            print(f"{one.label}: {one.error}", file=sys.stderr)
    end_with([one.error for one in found if one.error is not None])


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
    with open_lab(store) as lab:
        before = set(_outdated(lab))
        found = lab.correct(_changes(changes), by, reason, seen)
        if not found:
            print("nothing to correct: the store holds these values already")
            return
        rows = [[one.address, one.column, one.old or "empty", one.new or "empty"] for one in found]
        print_table("Corrected", ["row", "column", "before", "after"], rows)
        outdated = [name for name in _outdated(lab) if name not in before]
    if outdated:
        print(f"outdated now: the predictions of {', '.join(outdated)}; run 'pdlab predict'")


def _outdated(lab: "Lab") -> list[str]:
    frame = lab.predictions()
    return list(frame.loc[frame["state"] == "outdated", "mixture"].unique())


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


def delete(
    what: Annotated[str, typer.Argument(metavar="KIND:ROW", help="As aggregate:A, packing_test:5, run:ab12.")],
    yes: Annotated[bool, typer.Option("--yes", help="Delete, without which it is only said what would go.")] = False,
    by: Annotated[str | None, typer.Option(help="Who deletes; by default the login name.")] = None,
    reason: Annotated[str | None, typer.Option(help="Why.")] = None,
    store: Store = None,
) -> None:
    """Delete a row that nothing rests on, with its own parts."""
    with open_lab(store) as lab:
        print(f"deleted {lab.delete(what, by, reason, confirmed=yes)}")
