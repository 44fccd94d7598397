"""The services: register what users bring, calibrate, predict, compare; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.calibrations import CalibrationReport, RunAll, calibrate
from pdlab.experiments.predictions import PredictionReport, comparisons, predict
from pdlab.experiments.readings import current_grading, is_stale, measured_aggregate, measured_mixture, particle_density
from pdlab.experiments.registration import Registered, register

__all__ = [
    "CalibrationReport",
    "PredictionReport",
    "Registered",
    "RunAll",
    "calibrate",
    "comparisons",
    "current_grading",
    "is_stale",
    "measured_aggregate",
    "measured_mixture",
    "particle_density",
    "predict",
    "register",
]
