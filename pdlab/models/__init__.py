"""The tables, and nothing else."""

from pdlab.models.columns import NAMING, Base, Number, UtcDateTime, Whole, now
from pdlab.models.entered import (
    CORRECTABLE,
    Aggregate,
    Correction,
    Edited,
    Mixture,
    MixtureComponent,
    PackingTest,
    SieveAnalysis,
    SieveResult,
)
from pdlab.models.results import (
    RUN_LIST,
    STATES,
    Calibration,
    CalibrationRun,
    Prediction,
    PredictionCalibration,
    PredictionRun,
    Run,
    RunState,
    Wish,
)

__all__ = [
    "CORRECTABLE",
    "NAMING",
    "RUN_LIST",
    "STATES",
    "Aggregate",
    "Base",
    "Calibration",
    "CalibrationRun",
    "Correction",
    "Edited",
    "Mixture",
    "MixtureComponent",
    "Number",
    "PackingTest",
    "Prediction",
    "PredictionCalibration",
    "PredictionRun",
    "Run",
    "RunState",
    "SieveAnalysis",
    "SieveResult",
    "UtcDateTime",
    "Whole",
    "Wish",
    "now",
]
