"""The services: register what users bring, calibrate, predict, compare; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.calibrations import CalibrationReport, RunAll, calibrate
from pdlab.experiments.export import Exported, export_tables
from pdlab.experiments.predictions import PredictionReport, comparisons, predict
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.registration import Registered, register

__all__ = [
    "CalibrationReport",
    "Exported",
    "PredictionReport",
    "Registered",
    "RunAll",
    "Summary",
    "calibrate",
    "comparisons",
    "export_tables",
    "measured_aggregate",
    "predict",
    "register",
    "summaries",
]
