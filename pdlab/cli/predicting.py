"""Verbs that simulate: demo, calibrate, predict."""

import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import (
    LeaveOut,
    Method,
    MethodOrReference,
    Rule,
    Scheduler,
    Seeds,
    Store,
    Threads,
    Workers,
    check_writable,
    number,
    open_lab,
    print_table,
    raise_failures,
)
from pdlab.quantities import heading

if TYPE_CHECKING:
    from pdlab.calibration import Calibrated
    from pdlab.experiments import CalibrationReport, PredictionReport

PREDICTION = (
    "predicted", "standard_error", "input_error", "expected_error", "measured", "difference", "volume_mean",
    "toufar", "cpm",
)  # fmt: skip
DEMO_STORE = "sqlite:///pdlab-demo.db"


def _show_calibrations(reports: Sequence["CalibrationReport"]) -> None:
    done = [report for report in reports if report.result is not None]
    for method in dict.fromkeys(report.method for report in done):
        show = _show_angles if method == "repose" else _show_method
        show(method, [report for report in done if report.method == method])
    _print_notes(
        (report.aggregate, text)
        for report in reports
        for text in (*(report.result.warnings if report.result else ()), report.choice)
    )


def _print_notes(notes: Iterable[tuple[str, str]]) -> None:
    """Print what is to be said, each text once with all that it is said of."""
    names: dict[str, list[str]] = {}
    for name, text in notes:
        if text:
            names.setdefault(text, []).append(name)
    for text, all_of_it in names.items():
        print(f"note: {', '.join(all_of_it)}: {text}")


def _interval(result: "Calibrated") -> str:
    """Return the interval of a coefficient; an end that the curve passes is left open."""
    low = "0" if result.low is None else f"{result.low:.3g}"
    return f"{low} to {result.high:.3g}" if result.high is not None else f"{low} or more"


def _show_angles(method: str, reports: Sequence["CalibrationReport"]) -> None:
    rows = []
    for report in reports:
        result = report.result
        assert result is not None
        rows.append(
            [
                report.aggregate, f"{report.diameter:.2f}", f"{report.angle:.4g}", number(report.wall, 3),
                f"{result.value:.4g}", _interval(result), number(result.packing_density), number(result.input_error),
                number(result.curve_error), "" if math.isnan(report.measured) else number(report.measured),
            ]
        )  # fmt: skip
    columns = (
        "diameter", "measured_angle", "wall", "friction", "its interval", "vibrated", "input_error", "curve_error",
        "measured",
    )  # fmt: skip
    print_table(
        f"Calibrated friction to angles of repose (method {method}, diameter rule {reports[0].rule})",
        ["aggregate", *(name if name == "its interval" else heading(name) for name in columns)],
        rows,
    )


def _show_method(method: str, reports: Sequence["CalibrationReport"]) -> None:
    rows = []
    coefficient = "rolling" if method == "monosized_rolling" else "friction"
    for report in reports:
        result = report.result
        assert result is not None
        rows.append(
            [
                report.aggregate, f"{report.diameter:.2f}", number(report.measured), number(result.input_error),
                f"{result.value:.4g}", _interval(result), number(result.packing_density), number(result.curve_error),
            ]
        )  # fmt: skip
    columns = ("diameter", "measured", "input_error", coefficient, "simulated", "curve_error")
    print_table(
        f"Calibrated {'rolling friction at a friction of 1' if coefficient == 'rolling' else 'friction'} "
        f"(method {method}, diameter rule {reports[0].rule})",
        ["aggregate", *map(heading, columns[:4]), "its interval", *map(heading, columns[4:])],
        rows,
    )


def _show_predictions(reports: Sequence["PredictionReport"]) -> None:
    rows = [
        [
            report.mixture, number(report.packing_density), number(report.standard_error),
            number(report.input_error), number(report.expected_error), number(report.measured),
            number(report.difference, sign=True), number(report.volume_mean), number(report.toufar), number(report.cpm),
            report.state,
        ]
        for report in reports
    ]  # fmt: skip
    from pdlab.experiments import REFERENCES

    rules = ", ".join(sorted({report.rule for report in reports if report.rule})) or "none"
    shown = "Reference beside" if reports[0].method in REFERENCES else "Predicted against"
    print_table(
        f"{shown} measured packing density (method {reports[0].method}, diameter rule {rules})",
        [
            "mixture",
            *map(heading, PREDICTION),
            "state",
        ],
        rows,
    )
    compared = [report for report in reports if report.difference is not None and report.measured is not None]
    if compared:
        beside = {"volume mean of the aggregates": "volume_mean", "Toufar": "toufar", "CPM": "cpm"}
        others = {text: _mean_error(compared, name) for text, name in beside.items()}
        known = "; ".join(f"{text}: {value:.4f}" for text, value in others.items() if value is not None)
        print(
            f"mean absolute error over {len(compared)} mixtures: {_mean_error(compared, 'packing_density'):.4f} "
            f"({known or 'nothing else is known of all of them'})"
        )
    _print_notes((report.mixture, text) for report in reports if report.error is None for text in report.notes)
    _print_notes((report.mixture, report.tested_otherwise) for report in reports)
    _print_notes((report.mixture, report.theory_message) for report in reports)


def _mean_error(reports: Sequence["PredictionReport"], name: str) -> float | None:
    """Return the mean absolute error of one quantity against the measured ones, None where one has none."""
    errors = list[float]()
    for report in reports:
        value = getattr(report, name)
        if value is None or report.measured is None:
            return None
        errors.append(abs(value - report.measured))
    return sum(errors) / len(errors)


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
    method: Method = "monosized",
    rule: Rule = "log_mean",
    seeds: Annotated[int, typer.Option(min=2, help="Beds at each node of the curve.")] = 4,
    leave_out: LeaveOut = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
    scheduler: Scheduler = None,
) -> None:
    """Find each aggregate's friction coefficient: its simulated PD, or angle of repose, is the measured one."""
    with open_lab(store, workers, threads, scheduler) as lab:
        _show_calibrations(reports := lab.calibrate(aggregates or (), method, rule, seeds, leave_out))
        raise_failures(reports)


def predict(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    method: MethodOrReference = "monosized",
    rule: Rule = "log_mean",
    seeds: Seeds = 4,
    leave_out: LeaveOut = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Also write the table as CSV.")] = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
    scheduler: Scheduler = None,
) -> None:
    """Simulate mixtures and set their packing density beside the measured one."""
    from pdlab.experiments import Way
    from pdlab.frames import prediction_frame

    way = Way(method, rule, seeds, leave_out)
    if output is not None:
        check_writable(output)
    with open_lab(store, workers, threads, scheduler) as lab:
        reports = lab.predict_reports(mixtures or (), way)
        _show_predictions(reports)
        if output is not None:
            prediction_frame(reports).to_csv(output, index=False)
            print(f"written to {output}")
        raise_failures(reports)


def sheet(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    method: MethodOrReference = "monosized",
    rule: Rule = "log_mean",
    seeds: Seeds = 4,
    leave_out: LeaveOut = None,
    store: Store = None,
    workers: Workers = None,
    threads: Threads = 1,
) -> None:
    """Say how far each mixture's PD moves with what no test decides: diameter rule, damping, friction of a pair."""
    from pdlab.experiments import CHOICES

    with open_lab(store, workers, threads) as lab:
        sheets = lab.sheet(mixtures or (), method, rule, seeds, leave_out)
        for one in sheets:
            usual = one.report
            rows = [["as usual", method, number(usual.packing_density), number(usual.standard_error), "", usual.state]]
            for other in one.assumed:
                report, off = other.report, None
                if report.packing_density is not None and usual.packing_density is not None:
                    off = report.packing_density - usual.packing_density
                rows.append(
                    [
                        other.choice, other.name, number(report.packing_density), number(report.standard_error),
                        number(off, sign=True), report.state,
                    ]
                )  # fmt: skip
            columns = ("predicted", "standard_error")
            print_table(
                f"Assumptions behind {one.mixture} (method {method}, diameter rule {rule})",
                ["choice", "made", *map(heading, columns), "off", "state"],
                rows,
            )
            spreads = ((choice, one.spread(choice)) for choice in CHOICES)
            known = [f"{choice} {value:.4f}" for choice, value in spreads if value is not None]
            print(f"spread of the packing density: {', '.join(known)}")
            for other in one.assumed:
                if other.report.error is not None:
                    print(f"note: {other.choice} {other.name}: {other.report.error}")
        raise_failures([one.report for one in sheets])
