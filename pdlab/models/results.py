"""What was worked out: runs, calibrations and predictions with what they rest on, comparisons."""

import datetime as dt

from sqlalchemy import CheckConstraint, ForeignKey, Index, LargeBinary, String, text
from sqlalchemy.orm import Mapped, mapped_column, relationship

from pdlab.models.columns import Base, now, one_of
from pdlab.models.entered import Aggregate, Mixture, PackingTest, SieveAnalysis

STATES = ("queued", "running", "done", "failed", "cancelled")
RUN_LIST = (
    "finished_at", "specimen_hash", "state", "spheres", "seed", "packing_density", "coordination_number", "steps",
    "seconds", "rest", "engine_version",
)  # fmt: skip
"""What lists show of a run: one index holds it all, so that none reads the specimens of a large store."""


_KNOWN = text("engine_version > 0")
"""Of the index that tells the newest engine: a partial one, or lists would go through it row by row."""


class Wish:
    """Columns of what is asked for and computed: who asked when, who works on it, how far it is.

    ``variant``: empty for the method as it is, else a row of the assumption sheet, as ``pair_friction=mean``.
    ``asked``: how it is to be worked out, as JSON (``experiments.ways``); of a result that nobody wished for, None.
    """

    variant: Mapped[str] = mapped_column(String(64), default="", server_default="")
    asked: Mapped[str | None]
    state: Mapped[str] = mapped_column(String(16), default="queued")
    requested_at: Mapped[dt.datetime] = mapped_column(default=now)
    finished_at: Mapped[dt.datetime | None]
    priority: Mapped[int] = mapped_column(default=0)
    progress: Mapped[float] = mapped_column(default=0.0)
    message: Mapped[str | None]
    claimed_by: Mapped[str | None]
    heartbeat: Mapped[dt.datetime | None]


class Run(Base):
    """One simulated bed or heap, named by the SHA-256 of its specimen and engine version."""

    __tablename__ = "run"
    __table_args__ = (
        one_of("state", STATES),
        CheckConstraint("length(specimen_hash) = 64", name="specimen_hash"),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("repose_angle_deg BETWEEN 0 AND 90", name="repose_angle"),
        CheckConstraint(
            "state <> 'done' OR packing_density IS NOT NULL OR repose_angle_deg IS NOT NULL", name="done_has_result"
        ),
        CheckConstraint("steps >= 0 AND seconds >= 0", name="effort"),
        Index("ix_run_list", *RUN_LIST),
        Index("ix_run_newest_engine", "engine_version", sqlite_where=_KNOWN, postgresql_where=_KNOWN),
    )
    specimen_hash: Mapped[str] = mapped_column(String(64), primary_key=True)
    specimen: Mapped[str]
    engine_version: Mapped[int]
    numba_version: Mapped[str | None]
    processor: Mapped[str | None]
    seed: Mapped[int]
    spheres: Mapped[int]
    state: Mapped[str] = mapped_column(String(16))
    packing_density: Mapped[float | None]
    repose_angle_deg: Mapped[float | None]
    coordination_number: Mapped[float | None]
    height: Mapped[float | None]
    slab_shares: Mapped[str | None]
    largest_overlap: Mapped[float | None]
    rest: Mapped[str | None]
    steps: Mapped[int | None]
    seconds: Mapped[float | None]
    warnings: Mapped[str | None]
    claimed_by: Mapped[str | None]
    heartbeat: Mapped[dt.datetime | None]
    error: Mapped[str | None]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    finished_at: Mapped[dt.datetime | None]


class RunState(Base):
    """Where the spheres of a run lie: a compressed NumPy archive of place (N, 4) and species (N,).

    As the engine has them: x and y may lie outside the periodic box, a cylinder stands in the middle of its
    box; ``bedfiles.standing`` puts both in order.
    """

    __tablename__ = "run_state"
    specimen_hash: Mapped[str] = mapped_column(ForeignKey("run.specimen_hash", ondelete="CASCADE"), primary_key=True)
    steps: Mapped[int]
    archive: Mapped[bytes] = mapped_column(LargeBinary)


class Calibration(Wish, Base):
    """The friction coefficient whose simulated PD, or angle of repose, is an aggregate's measured one.

    ``spheres``: a JSON list of [diameter_mm, share] where the aggregate becomes spheres of several sizes, of which
    those below ``leave_out_below_mm`` are left out.
    """

    __tablename__ = "calibration"
    __table_args__ = (
        one_of("state", STATES),
        CheckConstraint("friction >= 0 AND friction_low >= 0 AND friction_high >= 0", name="friction"),
        CheckConstraint(
            "rolling_friction >= 0 AND rolling_friction_low >= 0 AND rolling_friction_high >= 0",
            name="rolling_friction",
        ),
        CheckConstraint("diameter_mm > 0", name="diameter"),
        CheckConstraint("measured_angle_deg BETWEEN 0 AND 90", name="measured_angle"),
        CheckConstraint("wall_friction >= 0", name="wall_friction"),
        CheckConstraint("leave_out_below_mm > 0", name="leave_out_below"),
        CheckConstraint("state <> 'done' OR friction IS NOT NULL", name="done_has_result"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
        Index(None, "aggregate_id"),
        Index(None, "state"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    aggregate_id: Mapped[int] = mapped_column(ForeignKey("aggregate.id"))
    sieve_analysis_id: Mapped[int] = mapped_column(ForeignKey("sieve_analysis.id"))
    packing_test_id: Mapped[int | None] = mapped_column(ForeignKey("packing_test.id"))
    method: Mapped[str] = mapped_column(String(32))
    protocol: Mapped[str]
    engine_version: Mapped[int | None]
    diameter_rule: Mapped[str] = mapped_column(String(32))
    diameter_mm: Mapped[float]
    spheres: Mapped[str | None]
    leave_out_below_mm: Mapped[float | None]
    measured_packing_density: Mapped[float | None]
    measured_angle_deg: Mapped[float | None]
    wall_friction: Mapped[float | None]
    friction: Mapped[float | None]
    friction_low: Mapped[float | None]
    friction_high: Mapped[float | None]
    rolling_friction: Mapped[float | None]
    rolling_friction_low: Mapped[float | None]
    rolling_friction_high: Mapped[float | None]
    packing_density: Mapped[float | None]
    input_error: Mapped[float | None]
    curve_error: Mapped[float | None]
    warnings: Mapped[str | None]
    aggregate: Mapped[Aggregate] = relationship()
    sieve_analysis: Mapped[SieveAnalysis] = relationship()
    packing_test: Mapped[PackingTest | None] = relationship()
    runs: Mapped[list["CalibrationRun"]] = relationship()


class CalibrationRun(Base):
    """A run that a calibration rests on."""

    __tablename__ = "calibration_run"
    __table_args__ = (Index(None, "specimen_hash"),)
    calibration_id: Mapped[int] = mapped_column(ForeignKey("calibration.id"), primary_key=True)
    specimen_hash: Mapped[str] = mapped_column(ForeignKey("run.specimen_hash"), primary_key=True)
    run: Mapped[Run] = relationship()


class Prediction(Wish, Base):
    """The simulated packing density of a mixture, with its errors."""

    __tablename__ = "prediction"
    __table_args__ = (
        one_of("state", STATES),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("standard_error >= 0 AND input_error >= 0", name="errors"),
        CheckConstraint("state <> 'done' OR packing_density IS NOT NULL", name="done_has_result"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
        Index("ix_prediction_newest", "mixture_id", "method", "variant", "requested_at", "id", "state"),
        Index(None, "state"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    mixture_id: Mapped[int] = mapped_column(ForeignKey("mixture.id"))
    method: Mapped[str] = mapped_column(String(32))
    protocol: Mapped[str]
    engine_version: Mapped[int | None]
    packing_density: Mapped[float | None]
    standard_error: Mapped[float | None]
    input_error: Mapped[float | None]
    warnings: Mapped[str | None]
    mixture: Mapped[Mixture] = relationship()
    runs: Mapped[list["PredictionRun"]] = relationship()
    calibrations: Mapped[list["PredictionCalibration"]] = relationship()


class PredictionRun(Base):
    """A run that a prediction rests on."""

    __tablename__ = "prediction_run"
    __table_args__ = (Index(None, "specimen_hash"),)
    prediction_id: Mapped[int] = mapped_column(ForeignKey("prediction.id"), primary_key=True)
    specimen_hash: Mapped[str] = mapped_column(ForeignKey("run.specimen_hash"), primary_key=True)
    run: Mapped[Run] = relationship()


class PredictionCalibration(Base):
    """A calibration that a prediction rests on."""

    __tablename__ = "prediction_calibration"
    __table_args__ = (Index(None, "calibration_id"),)
    prediction_id: Mapped[int] = mapped_column(ForeignKey("prediction.id"), primary_key=True)
    calibration_id: Mapped[int] = mapped_column(ForeignKey("calibration.id"), primary_key=True)
    calibration: Mapped[Calibration] = relationship()


class Sweep(Wish, Base):
    """Packing density along the proportions of two aggregates or more, and the densest mix [-] with its errors.

    ``wished_error``: standard error [-] of the densest mix at which no more is run; ``most_specimens``: proportions
    that may be simulated. ``curve``: what is drawn, as JSON (``experiments.sweeps``).
    """

    __tablename__ = "sweep"
    __table_args__ = (
        one_of("state", STATES),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("standard_error >= 0 AND input_error >= 0", name="errors"),
        CheckConstraint("wished_error > 0 AND most_specimens > 0", name="wished"),
        CheckConstraint("state <> 'done' OR packing_density IS NOT NULL", name="done_has_result"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
        Index(None, "state"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    method: Mapped[str] = mapped_column(String(32))
    wished_error: Mapped[float]
    most_specimens: Mapped[int]
    engine_version: Mapped[int | None]
    packing_density: Mapped[float | None]
    standard_error: Mapped[float | None]
    input_error: Mapped[float | None]
    curve: Mapped[str | None]
    warnings: Mapped[str | None]
    components: Mapped[list["SweepComponent"]] = relationship(order_by="SweepComponent.position")
    runs: Mapped[list["SweepRun"]] = relationship()
    calibrations: Mapped[list["SweepCalibration"]] = relationship()


class SweepComponent(Base):
    """An aggregate of a sweep, with its shares [-] of the densest mix and of the one to test next."""

    __tablename__ = "sweep_component"
    __table_args__ = (
        CheckConstraint("densest_share BETWEEN 0 AND 1", name="densest_share"),
        CheckConstraint("next_share BETWEEN 0 AND 1", name="next_share"),
        Index(None, "aggregate_id"),
    )
    sweep_id: Mapped[int] = mapped_column(ForeignKey("sweep.id"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    aggregate_id: Mapped[int] = mapped_column(ForeignKey("aggregate.id"))
    densest_share: Mapped[float | None]
    next_share: Mapped[float | None]
    aggregate: Mapped[Aggregate] = relationship()


class SweepRun(Base):
    """A run that a sweep rests on."""

    __tablename__ = "sweep_run"
    __table_args__ = (Index(None, "specimen_hash"),)
    sweep_id: Mapped[int] = mapped_column(ForeignKey("sweep.id"), primary_key=True)
    specimen_hash: Mapped[str] = mapped_column(ForeignKey("run.specimen_hash"), primary_key=True)
    run: Mapped[Run] = relationship()


class SweepCalibration(Base):
    """A calibration that a sweep rests on."""

    __tablename__ = "sweep_calibration"
    __table_args__ = (Index(None, "calibration_id"),)
    sweep_id: Mapped[int] = mapped_column(ForeignKey("sweep.id"), primary_key=True)
    calibration_id: Mapped[int] = mapped_column(ForeignKey("calibration.id"), primary_key=True)
    calibration: Mapped[Calibration] = relationship()


class Comparison(Base):
    """What the view ``predicted_vs_measured`` says of a mixture and a method, kept for the lists.

    ``method``: empty where the mixture was not predicted yet. ``compaction``: of the mixture's density test;
    ``simulated``: of the prediction's beds, missing where they have none. The store writes it (``store/keeping.py``).
    """

    __tablename__ = "comparison"
    __table_args__ = (
        Index(None, "prediction_id"),
        Index("ix_comparison_spread", "method", "engine_version", "simulated", "compaction", "difference"),
    )
    mixture_id: Mapped[int] = mapped_column(ForeignKey("mixture.id", ondelete="CASCADE"), primary_key=True)
    method: Mapped[str] = mapped_column(String(32), primary_key=True)
    mixture: Mapped[str]
    prediction_id: Mapped[int | None] = mapped_column(ForeignKey("prediction.id", ondelete="CASCADE"))
    state: Mapped[str] = mapped_column(String(16))
    engine_version: Mapped[int | None]
    predicted: Mapped[float | None]
    standard_error: Mapped[float | None]
    input_error: Mapped[float | None]
    compaction: Mapped[str | None]
    simulated: Mapped[str | None]
    measured: Mapped[float | None]
    difference: Mapped[float | None]
    message: Mapped[str | None]
    warnings: Mapped[str | None]
    outdated: Mapped[str | None]
    requested_at: Mapped[dt.datetime | None]


class Mark(Base):
    """A value that is another one after every change of what its name says: ``comparison``, of that table."""

    __tablename__ = "mark"
    name: Mapped[str] = mapped_column(String(32), primary_key=True)
    value: Mapped[str] = mapped_column(String(32))
