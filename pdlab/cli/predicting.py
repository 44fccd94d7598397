"""Verbs that simulate: demo, calibrate, predict."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import (
    Rule,
    Store,
    Threads,
    Workers,
    check_writable,
    number,
    open_lab,
    print_table,
    raise_failures,
)
from pdlab.errors import InputError
from pdlab.quantities import heading

if TYPE_CHECKING:
    from pdlab.experiments import CalibrationReport, PredictionReport

PREDICTION = (
    "predicted", "standard_error", "input_error", "expected_error", "measured", "difference", "volume_mean",
)  # fmt: skip
DEMO_STORE = "sqlite:///pdlab-demo.db"


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
                report.aggregate, f"{report.diameter:.2f}", number(report.measured), number(result.input_error),
                f"{result.friction:.4g}", interval, number(result.packing_density), number(result.curve_error),
            ]
        )  # fmt: skip
    if rows:
        rule = reports[0].rule
        columns = ("diameter", "measured", "input_error", "friction", "simulated", "curve_error")
        print_table(
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
            report.mixture, number(report.packing_density), number(report.standard_error),
            number(report.input_error), number(report.expected_error), number(report.measured),
            number(report.difference, sign=True), number(report.volume_mean), report.state,
        ]
        for report in reports
    ]  # fmt: skip
    rules = ", ".join(sorted({report.rule for report in reports if report.rule})) or "none"
    print_table(
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


def demo(store: Store = None, workers: Workers = None) -> None:
    """Feret's round pebbles: calibrate three fractions, predict their three mixtures, compare."""
    from pdlab.lab import SHIPPED

    with open_lab(store or os.environ.get("PDLAB_STORE") or DEMO_STORE, workers) as lab:
        print("Feret's round pebbles, three fractions and three mixtures (source: pdlab/data/README.md)")
        lab.import_tables(SHIPPED)
        names = list(dict.fromkeys(lab_rows(SHIPPED / "aggregates.csv", "name")))
        _show_calibrations(reports := lab.calibrate(names))
        raise_failures(reports)
        blends = list(dict.fromkeys(lab_rows(SHIPPED / "mixtures.csv", "mixture")))
        _show_predictions(predicted := lab.predict_reports(blends))
        raise_failures(predicted)
        print(f"{lab.runner.simulated} beds simulated, the others read from {lab.store.url}")
        print(f"see the page: pdlab serve --store {lab.store.url}")


def lab_rows(file: Path, column: str) -> list[str]:
    """Return a column of a shipped table."""
    import pandas as pd

    return list(pd.read_csv(file, dtype=str)[column])


def calibrate(
    aggregates: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    rule: Rule = "log_mean",
    seeds: Annotated[int, typer.Option(min=2, help="Beds at each node of the curve.")] = 4,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
) -> None:
    """Find each aggregate's friction coefficient: the one whose simulated PD is the measured PD."""
    with open_lab(store, workers, threads) as lab:
        _show_calibrations(reports := lab.calibrate(aggregates or (), rule, seeds))
        raise_failures(reports)


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
        check_writable(output)
    with open_lab(store, workers, threads) as lab:
        reports = lab.predict_reports(mixtures or (), rule, seeds)
        _show_predictions(reports)
        if output is not None:
            prediction_frame(reports).to_csv(output, index=False)
            print(f"written to {output}")
        raise_failures(reports)
