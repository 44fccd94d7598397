"""How far every method is from the measured mixtures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import Rule, Store, check_writable, number, open_lab, print_table
from pdlab.errors import InputError
from pdlab.quantities import QUANTITIES, heading

if TYPE_CHECKING:
    from pdlab.comparison import Figure
    from pdlab.experiments import Compared, MethodErrors

FIGURES = ("bias", "mean_absolute_error", "root_mean_square_error", "against_volume_mean")


def compare(
    mixtures: Annotated[list[str] | None, typer.Argument(help="All by default.")] = None,
    confidence: Annotated[float, typer.Option(help="Of the intervals.")] = 0.95,
    seed: Annotated[int, typer.Option(min=0, help="Of the bootstrap.")] = 1,
    rule: Rule = "log_mean",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write the figures as CSV, and beside them NAME-mixtures.csv."),
    ] = None,
    store: Store = None,
) -> None:
    """Compare every method with the measured mixtures: bias, errors and their intervals. Simulates nothing."""
    from pdlab.frames import comparison_frame, difference_frame

    files = []
    if output is not None:
        if output.suffix != ".csv":
            raise InputError(f"{output} does not end in .csv; name the file so")
        files = [output, output.with_name(f"{output.stem}-mixtures.csv")]
    with open_lab(store) as lab:
        found = lab.compare_report(mixtures or (), confidence, seed, rule)
    for file in files:
        check_writable(file)
    _show_mixtures(found)
    _show_errors(found, confidence, seed)
    _show_notes(found)
    for file, frame in zip(files, (comparison_frame(found), difference_frame(found)), strict=False):
        frame.to_csv(file, index=False)
        print(f"written to {file}")


def _name(method: str) -> str:
    """Return how a method is named in a table: a simulation's is what --method takes."""
    return heading(method) if method in QUANTITIES else method


def _show_mixtures(found: "Compared") -> None:
    rows = [
        [mixture, number(value), *(number(found.difference(method, mixture), sign=True) for method in found.outcomes)]
        for mixture, value in found.measured.items()
    ]
    print_table(
        "Predicted minus measured packing density",
        ["mixture", heading("measured"), *map(_name, found.outcomes)],
        rows,
    )


def _show_errors(found: "Compared", confidence: float, seed: int) -> None:
    intervals = f"{100.0 * confidence:g} % intervals by bootstrap, seed {seed}"
    if found.over_common:
        title = f"Errors over the {len(found.common)} mixtures that all methods have ({intervals})"
        print_table(title, *_table(found.over_common))
    else:
        print("no mixture is there that all methods have")
    if any(one.errors.mixtures != len(found.common) for one in found.over_own):
        print_table(f"Errors of each method over all that it has ({intervals})", *_table(found.over_own))


def _table(several: Sequence["MethodErrors"]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for one in several:
        cells = [_with_interval(one.figures.get(name), sign=name in (FIGURES[0], FIGURES[-1])) for name in FIGURES]
        largest = number(one.errors.largest, sign=True)
        rows.append([_name(one.method), str(one.errors.mixtures), *cells[:3], largest, cells[3]])
    columns = ["method", "n", *map(heading, FIGURES[:3]), heading("largest_error"), heading(FIGURES[3])]
    return columns, rows


def _with_interval(figure: "Figure | None", sign: bool) -> str:
    if figure is None:
        return ""
    value = number(figure.value, sign=sign)
    if figure.low is None or figure.high is None:
        return value
    return f"{value} ({number(figure.low, 3)}, {number(figure.high, 3)})"


def _show_notes(found: "Compared") -> None:
    from pdlab.comparison import FEW

    print(f"measured PDs have a standard error of {found.measured_error:.4f}, which is in every difference")
    counts = [one.errors.mixtures for one in (*found.over_common, *found.over_own)]
    if min(counts, default=FEW) < FEW:
        print(
            f"note: intervals over fewer than {FEW} mixtures are too narrow: at 3 they hold the truth in 2 of 3 cases"
        )
    gaps = {figure.no_interval for one in (*found.over_common, *found.over_own) for figure in one.figures.values()}
    for reason in sorted(gaps - {""}):
        print(f"note: no interval where {reason}")
    if found.index is not None:
        low, high = (f"{end:.3g}" for end in found.index)
        print(f"note: {_name('cpm_fitted')}: K fitted without the mixture itself, {low} to {high}")
    if found.unmeasured:
        print(f"note: not measured and left out: {_shortened(found.unmeasured)}")
    for method in found.outcomes:
        for reason, names in found.lacking(method).items():
            print(f"note: {_name(method)} lacks {_shortened(names)}: {reason}")


def _shortened(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
