"""The services: register, calibrate, predict, compare; show, verify, refresh, correct, delete; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.calibrations import CalibrationReport, RunAll, calibrate
from pdlab.experiments.corrections import Corrected, correct, delete
from pdlab.experiments.descent import Facts, show
from pdlab.experiments.export import Exported, export_tables
from pdlab.experiments.lists import counted, listed
from pdlab.experiments.predictions import PredictionReport, comparisons, predict
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.refreshing import Refreshed, refresh
from pdlab.experiments.registration import Registered, register
from pdlab.experiments.verification import Verified, verify

__all__ = [
    "CalibrationReport",
    "Corrected",
    "Exported",
    "Facts",
    "PredictionReport",
    "Refreshed",
    "Registered",
    "RunAll",
    "Summary",
    "Verified",
    "calibrate",
    "comparisons",
    "correct",
    "counted",
    "delete",
    "export_tables",
    "listed",
    "measured_aggregate",
    "predict",
    "refresh",
    "register",
    "show",
    "summaries",
    "verify",
]
