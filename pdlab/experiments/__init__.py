"""The services: register, calibrate, predict, compare; show, verify, refresh, correct, delete; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.assumptions import CHOICES, Assumed, Sheet, sheet
from pdlab.experiments.beds import DrawnBed, prediction_bed
from pdlab.experiments.calibrations import CalibrationReport, calibrate, to_calibrate
from pdlab.experiments.comparing import Compared, MethodErrors, compare
from pdlab.experiments.comparisons import comparisons
from pdlab.experiments.corrections import Corrected, correct, delete
from pdlab.experiments.descent import Facts, show
from pdlab.experiments.drafts import Drafted, delete_draft, list_drafts, load_draft, save_draft
from pdlab.experiments.effort import known_runs
from pdlab.experiments.entering import (
    AGGREGATE_TEXTS,
    SIEVE_TEXTS,
    TEST_TEXTS,
    AggregateRead,
    EnteredAggregate,
    SievesRead,
    TestRead,
    entered_of,
    read_entered,
    register_entered,
    sentences,
)
from pdlab.experiments.explaining import (
    CurveNode,
    DrawnCurve,
    Explained,
    ask_calibration,
    explain,
    waiting_calibration,
)
from pdlab.experiments.export import Exported, export_tables
from pdlab.experiments.forecasts import beds_to_run
from pdlab.experiments.lists import counted, listed
from pdlab.experiments.mixing import (
    Composed,
    SharesRead,
    ask_prediction,
    compose,
    composition,
    mixture_names,
    read_shares,
    register_mixture,
    waiting_prediction,
)
from pdlab.experiments.parity import (
    LISTED,
    STATES,
    Cell,
    Density,
    Filters,
    Judged,
    Parity,
    Points,
    aggregates_in_mixtures,
    methods_used,
    parity,
    parity_csv,
)
from pdlab.experiments.predictions import answered, predict, to_predict
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.refreshing import Refreshed, refresh
from pdlab.experiments.registration import Registered, register, register_each
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.sweeps import SweepReport, sweep_aggregates, to_sweep
from pdlab.experiments.theories import Theoretical, by_theory
from pdlab.experiments.verification import Verified, verify
from pdlab.experiments.waiting import Waiting
from pdlab.experiments.ways import METHODS, OTHERS, Way
from pdlab.experiments.wishes import (
    Asked,
    Report,
    answering,
    ask_calibrations,
    ask_predictions,
    ask_sweep,
    cancel,
    report_on,
)
from pdlab.plan import RunAll

__all__ = [
    "AGGREGATE_TEXTS",
    "CHOICES",
    "LISTED",
    "METHODS",
    "OTHERS",
    "REFERENCES",
    "SIEVE_TEXTS",
    "STATES",
    "TEST_TEXTS",
    "AggregateRead",
    "Asked",
    "Assumed",
    "CalibrationReport",
    "Cell",
    "Compared",
    "Composed",
    "Corrected",
    "CurveNode",
    "Density",
    "Drafted",
    "DrawnBed",
    "DrawnCurve",
    "EnteredAggregate",
    "Explained",
    "Exported",
    "Facts",
    "Filters",
    "Judged",
    "MethodErrors",
    "Parity",
    "Points",
    "PredictionReport",
    "Refreshed",
    "Registered",
    "Report",
    "RunAll",
    "SharesRead",
    "Sheet",
    "SievesRead",
    "Summary",
    "SweepReport",
    "TestRead",
    "Theoretical",
    "Verified",
    "Waiting",
    "Way",
    "aggregates_in_mixtures",
    "answered",
    "answering",
    "ask_calibration",
    "ask_calibrations",
    "ask_prediction",
    "ask_predictions",
    "ask_sweep",
    "beds_to_run",
    "by_theory",
    "calibrate",
    "cancel",
    "compare",
    "comparisons",
    "compose",
    "composition",
    "correct",
    "counted",
    "delete",
    "delete_draft",
    "entered_of",
    "explain",
    "export_tables",
    "known_runs",
    "list_drafts",
    "listed",
    "load_draft",
    "measured_aggregate",
    "methods_used",
    "mixture_names",
    "parity",
    "parity_csv",
    "predict",
    "prediction_bed",
    "read_entered",
    "read_shares",
    "refresh",
    "register",
    "register_each",
    "register_entered",
    "register_mixture",
    "report_on",
    "save_draft",
    "sentences",
    "sheet",
    "show",
    "summaries",
    "sweep_aggregates",
    "to_calibrate",
    "to_predict",
    "to_sweep",
    "verify",
    "waiting_calibration",
    "waiting_prediction",
]
