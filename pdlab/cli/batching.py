"""Verbs for many mixtures, and the runner that works for the page: batch, runner."""

import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import (
    Bar,
    LeaveOut,
    MethodOrReference,
    Rule,
    Scheduler,
    Seeds,
    Store,
    Threads,
    Workers,
    duration,
    end_as_by_ctrl_c,
    end_with,
    open_lab,
    print_table,
)

if TYPE_CHECKING:
    from pdlab.batch.many import Summary, Survey, Told
    from pdlab.errors import PdlabError
    from pdlab.lab import Lab
    from pdlab.planning import Range

CLUSTERS = (2, 8, 32, 128)
"""Workers for which a plan says how long it takes, besides those at hand."""


def batch(
    table: Annotated[Path, typer.Argument(help="A table like mixtures.csv, or a workbook of it.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV file, a row for each mixture as it comes.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would be run and how long it takes; write nothing.")
    ] = False,
    method: MethodOrReference = "monosized",
    rule: Rule = "log_mean",
    seeds: Seeds = 4,
    leave_out: LeaveOut = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
    scheduler: Scheduler = None,
) -> None:
    """Predict a table of any length; what is known is read, and a table that was stopped goes on where it was."""
    if output is None and not dry_run:
        raise typer.BadParameter("name the file for the results with -o, or ask for a --dry-run")
    bar = Bar()
    with open_lab(store, workers, threads, scheduler, bar) as lab:
        if dry_run:
            _show_plan(lab, lab.plan(table, method, rule, seeds, leave_out), table)
            return
        assert output is not None
        plans, errors = list["Survey"](), list["PdlabError"]()

        def note_survey(found: "Survey") -> None:
            plans.append(found)
            bar.mixtures, bar.sphere_steps = int(found.pending.sum()), found.estimate.sphere_steps.value

        def note_row(told: "Told") -> None:
            bar.rows += bool(plans)  # what was read before the survey is no work
            if told.report.error is not None:
                errors.append(told.report.error)

        try:
            summary = lab.batch(table, output, method, rule, seeds, leave_out, note_survey, note_row)
        except KeyboardInterrupt:
            bar.hide()
            print(f"stopped; what is done is kept, and the same command goes on from there ({output})", file=sys.stderr)
            raise typer.Exit(130) from None
        bar.hide()
        _show_summary(lab, summary, plans[0], output)
        end_with(errors)


def _show_plan(lab: "Lab", found: "Survey", table: Path) -> None:
    estimate, pending = found.estimate, int(found.pending.sum())
    failed = f", {found.failed} that cannot be: their rows will say why" if found.failed else ""
    print(f"{table}: {len(found.pending)} mixtures, {found.read} known, {pending} to be predicted{failed}")
    if not estimate.runs:
        print("nothing is to be run")
        return
    print(
        f"{estimate.runs} new runs at first, {estimate.spheres / 1e6:.3g} million spheres, "
        f"{_steps(estimate.sphere_steps)} sphere-steps; more seeds where the standard error asks for them"
    )
    here = lab.runner.pool.workers
    rows = []
    for count in dict.fromkeys((here, *CLUSTERS)):
        time = estimate.seconds(count)
        rows.append([f"{count}{' (here)' if count == here else ''}", duration(time.value), _between(time)])
    print_table("How long that takes", ["workers", "time", "90 % lie between"], rows)
    if not estimate.measured:
        print("note: no run of this machine is in the store yet; another machine's speed stands in for its own")


def _show_summary(lab: "Lab", summary: "Summary", plan: "Survey", output: Path) -> None:
    print(
        f"written to {output}: {summary.mixtures} mixtures, {summary.predicted} predicted, {summary.read} read, "
        f"{summary.failed} failed{' (their message says why)' if summary.failed else ''}"
    )
    if not plan.estimate.runs:
        return
    estimate, time = plan.estimate, plan.estimate.seconds(lab.runner.pool.workers)
    print(f"simulated: {summary.runs} beds, {summary.sphere_steps:.3g} sphere-steps in {duration(summary.seconds)}")
    print(
        f"estimated: {estimate.runs} beds, {_steps(estimate.sphere_steps)} sphere-steps in {duration(time.value)} "
        f"({_between(time)}), {time.value / summary.seconds:.2g} times what it took"
    )


def _steps(steps: "Range") -> str:
    return f"{steps.value:.3g} ({steps.low:.3g} to {steps.high:.3g})"


def _between(time: "Range") -> str:
    return f"{duration(time.low)} to {duration(time.high)}"


def runner(
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
    scheduler: Scheduler = None,
) -> None:
    """Work on what is wished for on the page or by others, until Ctrl-C; several runners may share a store."""
    import os

    from pdlab.batch.working import serve

    end_as_by_ctrl_c()
    if hasattr(os, "nice"):
        os.nice(15)  # the page comes first, and all cores are busy
    with open_lab(store, workers, threads, scheduler) as lab:
        logging.getLogger("pdlab").setLevel(logging.INFO)
        print(f"the runner: {lab.runner.pool.workers} beds at once for {lab.store.url} (Ctrl-C ends it)", flush=True)
        try:
            serve(lab.runner)
        except KeyboardInterrupt:
            print("the runner has ended; what it worked on waits for the next", flush=True)
