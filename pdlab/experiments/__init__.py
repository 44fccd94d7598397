"""The services: register, calibrate, predict, compare; show, verify, refresh, correct, delete; one transaction each.

Whatever must be simulated goes to ``run_all``, which is handed in, so that this room knows no engine.
"""

from pdlab.experiments.assumptions import CHOICES, Assumed, Sheet, sheet
from pdlab.experiments.beds import DrawnBed, prediction_bed
from pdlab.experiments.calibrations import CalibrationReport, calibrate, to_calibrate
from pdlab.experiments.comparing import Compared, MethodErrors, compare
from pdlab.experiments.comparisons import comparisons
from pdlab.experiments.corrections import Corrected, correct, delete
from pdlab.experiments.damage import damage_named, damages
from pdlab.experiments.descent import Facts, show
from pdlab.experiments.documents import (
    REPORTED,
    AggregateDocument,
    Amount,
    MixtureDocument,
    Versions,
    aggregate_document,
    mixture_document,
    reported,
)
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
    entered_again,
    entered_of,
    read_entered,
    register_entered,
    sentences,
)
from pdlab.experiments.evidence import (
    AggregateInputs,
    DensityTest,
    ShownCalibration,
    ShownCorrection,
    ShownRun,
    SieveLine,
    SieveTest,
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
from pdlab.experiments.first_steps import SHIPPED, FirstSteps, first_steps, load_example
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
from pdlab.experiments.proportions import (
    ListedSweep,
    Proportions,
    ask_proportions,
    newest_sweeps,
    proportions,
    waiting_sweep,
)
from pdlab.experiments.readings import Summary, measured_aggregate, summaries
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.refreshing import Refreshed, refresh
from pdlab.experiments.registration import Registered, register, register_each
from pdlab.experiments.reports import PredictionReport
from pdlab.experiments.sweeps import MeasuredMix, SweepReport, sweep_aggregates, to_sweep
from pdlab.experiments.theories import Theoretical, by_theory
from pdlab.experiments.verification import Verified, verify
from pdlab.experiments.waiting import Pace, Waiting
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
    "REPORTED",
    "SHIPPED",
    "SIEVE_TEXTS",
    "STATES",
    "TEST_TEXTS",
    "AggregateDocument",
    "AggregateInputs",
    "AggregateRead",
    "Amount",
    "Asked",
    "Assumed",
    "CalibrationReport",
    "Cell",
    "Compared",
    "Composed",
    "Corrected",
    "CurveNode",
    "Density",
    "DensityTest",
    "Drafted",
    "DrawnBed",
    "DrawnCurve",
    "EnteredAggregate",
    "Explained",
    "Exported",
    "Facts",
    "Filters",
    "FirstSteps",
    "Judged",
    "ListedSweep",
    "MeasuredMix",
    "MethodErrors",
    "MixtureDocument",
    "Pace",
    "Parity",
    "Points",
    "PredictionReport",
    "Proportions",
    "Refreshed",
    "Registered",
    "Report",
    "RunAll",
    "SharesRead",
    "Sheet",
    "ShownCalibration",
    "ShownCorrection",
    "ShownRun",
    "SieveLine",
    "SieveTest",
    "SievesRead",
    "Summary",
    "SweepReport",
    "TestRead",
    "Theoretical",
    "Verified",
    "Versions",
    "Waiting",
    "Way",
    "aggregate_document",
    "aggregates_in_mixtures",
    "answered",
    "answering",
    "ask_calibration",
    "ask_calibrations",
    "ask_prediction",
    "ask_predictions",
    "ask_proportions",
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
    "damage_named",
    "damages",
    "delete",
    "delete_draft",
    "entered_again",
    "entered_of",
    "explain",
    "export_tables",
    "first_steps",
    "known_runs",
    "list_drafts",
    "listed",
    "load_draft",
    "load_example",
    "measured_aggregate",
    "methods_used",
    "mixture_document",
    "mixture_names",
    "newest_sweeps",
    "parity",
    "parity_csv",
    "predict",
    "prediction_bed",
    "proportions",
    "read_entered",
    "read_shares",
    "refresh",
    "register",
    "register_each",
    "register_entered",
    "register_mixture",
    "report_on",
    "reported",
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
    "waiting_sweep",
]
