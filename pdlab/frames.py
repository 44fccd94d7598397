"""What the services report, as rows and pandas frames."""

from collections.abc import Iterable

import pandas as pd

from pdlab.experiments import Compared, PredictionReport, SweepReport

PREDICTION_COLUMNS = (
    "mixture", "method", "packing_density", "standard_error", "input_error", "expected_error", "measured",
    "difference", "toufar", "cpm", "state", "message",
)  # fmt: skip


def prediction_row(report: PredictionReport) -> dict[str, object]:
    """Return a report's columns; the message also says why a theory is missing."""
    notes = [note for note in (report.message, report.theory_message) if note]
    return {name: getattr(report, name) for name in PREDICTION_COLUMNS} | {"message": "; ".join(notes)}


def text_row(report: PredictionReport) -> dict[str, str]:
    """Return a report's columns as text, as they stand in a CSV file."""
    return {name: "" if value is None else str(value) for name, value in prediction_row(report).items()}


def prediction_frame(reports: Iterable[PredictionReport]) -> pd.DataFrame:
    """Return reports as a frame with a row each."""
    return pd.DataFrame([prediction_row(report) for report in reports], columns=list(PREDICTION_COLUMNS))


def sweep_frame(report: SweepReport) -> pd.DataFrame:
    """Return a sweep as a frame: a row for each place of the grid, the aggregates' shares, PD and its deviation [-]."""
    if report.result is None:
        return pd.DataFrame(columns=[*report.aggregates, "packing_density", "standard_error"])
    frame = pd.DataFrame(report.result.shares, columns=list(report.aggregates))
    frame["packing_density"], frame["standard_error"] = report.result.packing_density, report.result.deviation
    return frame


def comparison_frame(found: Compared) -> pd.DataFrame:
    """Return a comparison as a frame: each method's errors over the common mixtures and over its own."""
    rows = []
    for over, several in (("common", found.over_common), ("own", found.over_own)):
        for one in several:
            row: dict[str, object] = {"over": over, "method": one.method, "mixtures": one.errors.mixtures}
            for name, figure in one.figures.items():
                row |= {name: figure.value, f"{name}_low": figure.low, f"{name}_high": figure.high}
            rows.append(row | {"largest_error": one.errors.largest, "largest_mixture": one.worst})
    return pd.DataFrame(rows)


def difference_frame(found: Compared) -> pd.DataFrame:
    """Return a comparison mixture by mixture: the measured packing density and each method's less that [-]."""
    rows = [
        {"mixture": mixture, "measured": value}
        | {method: found.difference(method, mixture) for method in found.outcomes}
        for mixture, value in found.measured.items()
    ]
    return pd.DataFrame(rows)
