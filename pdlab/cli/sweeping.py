"""The verb that goes over the proportions of aggregates: sweep."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import (
    LeaveOut,
    Method,
    Rule,
    Scheduler,
    Store,
    Threads,
    Workers,
    check_writable,
    end_with,
    number,
    open_lab,
    print_table,
)
from pdlab.quantities import heading

if TYPE_CHECKING:
    from pdlab.experiments import SweepReport
    from pdlab.sweep import Swept


def sweep(
    aggregates: Annotated[list[str], typer.Argument(help="Two to five.")],
    method: Method = "monosized",
    rule: Rule = "log_mean",
    standard_error: Annotated[float, typer.Option(help="Of the densest mix's PD, at which it ends.")] = 0.001,
    most: Annotated[
        int | None, typer.Option(min=1, help="Beds at most; 12 for two aggregates, 30, 50, 70 for more by default.")
    ] = None,
    leave_out: LeaveOut = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Also write the whole curve as CSV.")] = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
    scheduler: Scheduler = None,
) -> None:
    """Find the densest mix of aggregates by as few beds as it takes, and the mix to test next."""
    from pdlab.frames import sweep_frame

    if output is not None:
        check_writable(output)
    with open_lab(store, workers, threads, scheduler) as lab:
        report = lab.sweep(aggregates, method, rule, standard_error, most, leave_out=leave_out)
        if report.result is not None:
            _show(report, report.result)
        if report.error is not None:
            print(f"{' + '.join(report.aggregates)}: {report.error}", file=sys.stderr)
        elif output is not None:
            sweep_frame(report).to_csv(output, index=False)
            print(f"written to {output}")
        end_with([] if report.error is None else [report.error])


def _show(report: "SweepReport", result: "Swept") -> None:
    points = sorted(result.points, key=lambda point: point.shares, reverse=True)
    print_table(
        f"Beds along {' + '.join(report.aggregates)} (method {report.method}, diameter rule {report.rule})",
        [*(f"share of {name}" for name in report.aggregates), heading("simulated"), "± one bed", "run"],
        [
            [*(f"{share:g}" for share in point.shares), number(point.packing_density), number(point.standard_error),
             point.digest[:12]]
            for point in points
        ],
    )  # fmt: skip
    best = result.densest
    print_table(
        "Densest mix",
        ["aggregate", "share", "its interval"],
        [
            [name, f"{share:g}", f"{low:.3g} to {high:.3g}"]
            for name, share, low, high in zip(report.aggregates, best.shares, best.low, best.high, strict=True)
        ],
    )
    print(
        f"its packing density: {best.packing_density:.4f} ± {best.standard_error:.4f} (simulation) "
        f"± {best.input_error:.4f} (inputs); no other proportions are denser by more than {best.to_gain:.4f}, at 95 %"
    )
    _show_next(report.aggregates, result)
    for text in report.notes:
        print(f"note: {text}")
    print(f"kept as sweep:{report.sweep_id}; {len(result.points)} beds, see 'pdlab show sweep:{report.sweep_id}'")


def _show_next(names: Sequence[str], result: "Swept") -> None:
    test = result.next_test
    if test is None:
        print("to test next: nothing; all mixes that can be simulated are measured")
        return
    mix = ", ".join(f"{share:g} of {name}" for name, share in zip(names, test.shares, strict=True) if share > 0.0)
    print(f"to test next: {mix}, expected at {test.packing_density:.4f} ± {test.error:.4f} (all errors)")
    print(f"why: {test.why}")
