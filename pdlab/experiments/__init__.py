"""The services: register, calibrate, predict, compare; show, verify, refresh, correct, delete; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.assumptions import CHOICES, Assumed, Sheet, sheet
from pdlab.experiments.calibrations import CalibrationReport, calibrate
from pdlab.experiments.comparing import Compared, MethodErrors, compare
from pdlab.experiments.corrections import Corrected, correct, delete
from pdlab.experiments.curves import RunAll
from pdlab.experiments.descent import Facts, show
from pdlab.experiments.effort import known_runs
from pdlab.experiments.export import Exported, export_tables
from pdlab.experiments.lists import counted, listed
from pdlab.experiments.predictions import PredictionReport, comparisons, predict
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.refreshing import Refreshed, refresh
from pdlab.experiments.registration import Registered, register, register_each
from pdlab.experiments.theories import Theoretical, by_theory
from pdlab.experiments.verification import Verified, verify
from pdlab.experiments.ways import METHODS, Way

__all__ = [
    "CHOICES",
    "METHODS",
    "REFERENCES",
    "Assumed",
    "CalibrationReport",
    "Compared",
    "Corrected",
    "Exported",
    "Facts",
    "MethodErrors",
    "PredictionReport",
    "Refreshed",
    "Registered",
    "RunAll",
    "Sheet",
    "Summary",
    "Theoretical",
    "Verified",
    "Way",
    "by_theory",
    "calibrate",
    "compare",
    "comparisons",
    "correct",
    "counted",
    "delete",
    "export_tables",
    "known_runs",
    "listed",
    "measured_aggregate",
    "predict",
    "refresh",
    "register",
    "register_each",
    "sheet",
    "show",
    "summaries",
    "verify",
]
