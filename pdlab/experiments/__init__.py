"""The services: register what users bring, calibrate, predict, compare; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.calibrations import CalibrationReport, RunAll, calibrate
from pdlab.experiments.lists import counted, listed
from pdlab.experiments.predictions import PredictionReport, comparisons, predict
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.registration import Registered, register

__all__ = [
    "CalibrationReport",
    "PredictionReport",
    "Registered",
    "RunAll",
    "Summary",
    "calibrate",
    "comparisons",
    "counted",
    "listed",
    "measured_aggregate",
    "predict",
    "register",
    "summaries",
]
