"""The tables, and nothing else."""

import datetime as dt
import math
import operator
from typing import Any, ClassVar

from sqlalchemy import (
    CheckConstraint,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Text,
    TypeDecorator,
    UniqueConstraint,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, declared_attr, mapped_column, relationship

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}
CORRECTABLE = ("aggregate", "sieve_analysis", "sieve_result", "packing_test", "mixture", "mixture_component")
STATES = ("queued", "running", "done", "failed", "cancelled")
RUN_LIST = (
    "finished_at", "specimen_hash", "state", "spheres", "seed", "packing_density", "coordination_number", "steps",
    "seconds", "rest", "engine_version",
)  # fmt: skip
"""What lists show of a run: one index holds it all, so that none reads the specimens of a large store."""


class UtcDateTime(TypeDecorator[dt.datetime]):
    """Points in time, stored in UTC without an offset, aware in Python."""

    impl = DateTime
    cache_ok = True
    python_type = dt.datetime

    def process_bind_param(self, value: dt.datetime | None, dialect: Dialect) -> Any:
        """Refuse a naive time; store UTC."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value} has no time zone")
        return value.astimezone(dt.UTC).replace(tzinfo=None)

    def process_result_value(self, value: dt.datetime | None, dialect: Dialect) -> dt.datetime | None:
        """Return an aware time."""
        return None if value is None else value.replace(tzinfo=dt.UTC)


class Number(TypeDecorator[float]):
    """A number, NumPy's too; NaN is stored as NULL, which SQLite would do unasked and PostgreSQL would not."""

    impl = Double
    cache_ok = True
    python_type = float

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Return a float of Python's own, None for NaN."""
        return None if value is None or math.isnan(value) else float(value)


class Whole(TypeDecorator[int]):
    """A whole number, NumPy's too, which SQLite would keep as bytes."""

    impl = Integer
    cache_ok = True
    python_type = int

    def process_bind_param(self, value: int | None, dialect: Dialect) -> int | None:
        """Return an int of Python's own; refuse what is none."""
        return None if value is None else operator.index(value)


def now() -> dt.datetime:
    """Return the present time in UTC."""
    return dt.datetime.now(dt.UTC)


class Base(DeclarativeBase):
    """Base of all tables."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map: ClassVar[dict[Any, Any]] = {dt.datetime: UtcDateTime, str: Text, float: Number, int: Whole}


def _one_of(column: str, values: tuple[str, ...], optional: bool = False) -> CheckConstraint:
    """Allow the values of a vocabulary only, and NULL where ``optional``."""
    allowed = ", ".join(f"'{value}'" for value in values)
    null = f"{column} IS NULL OR " if optional else ""
    return CheckConstraint(f"{null}{column} IN ({allowed})", name=column)


def _exactly_one(*columns: str) -> CheckConstraint:
    """Allow rows in which one of the columns is given, and no other."""
    count = " + ".join(f"CASE WHEN {column} IS NULL THEN 0 ELSE 1 END" for column in columns)
    return CheckConstraint(f"{count} = 1", name="one_value")


class Edited:
    """A row that people edit: whoever writes over what another has changed since is told (StaleDataError)."""

    version: Mapped[int] = mapped_column(server_default="1")

    @declared_attr.directive
    def __mapper_args__(cls) -> dict[str, Any]:  # noqa: N805
        return {"version_id_col": cls.version}


class Aggregate(Edited, Base):
    """A delivery of an aggregate; the newest delivery of a name is the current one."""

    __tablename__ = "aggregate"
    __table_args__ = (
        UniqueConstraint("name", "delivery"),
        CheckConstraint("name <> ''", name="name"),
        CheckConstraint("particle_density_kg_m3 > 0", name="particle_density"),
        CheckConstraint("(particle_density_kg_m3 IS NULL) = (density_basis IS NULL)", name="density_has_basis"),
        _one_of("density_basis", ("oven_dry", "ssd", "apparent"), optional=True),
        CheckConstraint("water_absorption_percent >= 0 AND water_absorption_percent < 100", name="absorption"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    delivery: Mapped[str]
    particle_density_kg_m3: Mapped[float | None]
    density_basis: Mapped[str | None] = mapped_column(String(16))
    water_absorption_percent: Mapped[float | None]
    shape: Mapped[str | None]
    source: Mapped[str | None]
    repose_angle_deg: Mapped[float | None]
    wall_angle_deg: Mapped[float | None]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    sieve_analyses: Mapped[list["SieveAnalysis"]] = relationship(
        back_populates="aggregate", order_by="SieveAnalysis.id"
    )
    packing_tests: Mapped[list["PackingTest"]] = relationship(back_populates="aggregate", order_by="PackingTest.id")


class SieveAnalysis(Edited, Base):
    """One sieve test of an aggregate; the newest is the current one."""

    __tablename__ = "sieve_analysis"
    __table_args__ = (
        CheckConstraint("sample_mass_g > 0", name="sample_mass"),
        CheckConstraint("pan_lower_mm > 0", name="pan_lower"),
        _one_of("kind", ("retained_g", "retained_percent", "passing_percent")),
        Index(None, "aggregate_id"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    aggregate_id: Mapped[int] = mapped_column(ForeignKey("aggregate.id"))
    kind: Mapped[str] = mapped_column(String(16))
    sample_mass_g: Mapped[float | None]
    pan_lower_mm: Mapped[float | None]
    standard: Mapped[str | None]
    date: Mapped[dt.date | None]
    raw_text: Mapped[str | None]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    aggregate: Mapped[Aggregate] = relationship(back_populates="sieve_analyses")
    results: Mapped[list["SieveResult"]] = relationship(order_by="SieveResult.position")


class SieveResult(Base):
    """What one sieve held or let pass; a NULL aperture is the pan."""

    __tablename__ = "sieve_result"
    __table_args__ = (
        UniqueConstraint("sieve_analysis_id", "aperture_mm"),
        CheckConstraint("aperture_mm > 0", name="aperture"),
        CheckConstraint("retained_g >= 0", name="retained_g"),
        CheckConstraint("retained_percent BETWEEN 0 AND 100", name="retained_percent"),
        CheckConstraint("passing_percent BETWEEN 0 AND 100", name="passing_percent"),
        _exactly_one("retained_g", "retained_percent", "passing_percent"),
    )
    sieve_analysis_id: Mapped[int] = mapped_column(ForeignKey("sieve_analysis.id"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    aperture_mm: Mapped[float | None]
    retained_g: Mapped[float | None]
    retained_percent: Mapped[float | None]
    passing_percent: Mapped[float | None]
    raw_text: Mapped[str]


class Mixture(Edited, Base):
    """A mixture of aggregates."""

    __tablename__ = "mixture"
    __table_args__ = (UniqueConstraint("name"), CheckConstraint("name <> ''", name="name"))
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    components: Mapped[list["MixtureComponent"]] = relationship(order_by="MixtureComponent.position")
    packing_tests: Mapped[list["PackingTest"]] = relationship(back_populates="mixture", order_by="PackingTest.id")


class MixtureComponent(Base):
    """An aggregate's share of a mixture; ``mass_share`` stands where that was entered."""

    __tablename__ = "mixture_component"
    __table_args__ = (
        UniqueConstraint("mixture_id", "aggregate_id"),
        CheckConstraint("solid_volume_share > 0 AND solid_volume_share <= 1", name="solid_volume_share"),
        CheckConstraint("mass_share > 0 AND mass_share <= 1", name="mass_share"),
        Index(None, "aggregate_id"),
        Index("ix_mixture_component_shares", "mixture_id", "aggregate_id", "solid_volume_share"),
    )
    mixture_id: Mapped[int] = mapped_column(ForeignKey("mixture.id"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    aggregate_id: Mapped[int] = mapped_column(ForeignKey("aggregate.id"))
    solid_volume_share: Mapped[float]
    mass_share: Mapped[float | None]
    aggregate: Mapped[Aggregate] = relationship()


class PackingTest(Edited, Base):
    """A density test of an aggregate or a mixture; the newest is the current one."""

    __tablename__ = "packing_test"
    __table_args__ = (
        CheckConstraint("(aggregate_id IS NULL) <> (mixture_id IS NULL)", name="one_material"),
        _one_of("compaction", ("loose", "rodded", "vibrated", "unstated")),
        _exactly_one("bulk_density_kg_m3", "voids_percent", "packing_density"),
        CheckConstraint("bulk_density_kg_m3 > 0", name="bulk_density"),
        CheckConstraint("voids_percent > 0 AND voids_percent < 100", name="voids"),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("repeats >= 1", name="repeats"),
        CheckConstraint("standard_deviation >= 0", name="standard_deviation"),
        CheckConstraint("container_diameter_mm > 0 AND container_height_mm > 0", name="container"),
        Index(None, "aggregate_id"),
        Index(None, "mixture_id"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    aggregate_id: Mapped[int | None] = mapped_column(ForeignKey("aggregate.id"))
    mixture_id: Mapped[int | None] = mapped_column(ForeignKey("mixture.id"))
    compaction: Mapped[str] = mapped_column(String(16))
    bulk_density_kg_m3: Mapped[float | None]
    voids_percent: Mapped[float | None]
    packing_density: Mapped[float | None]
    repeats: Mapped[int | None]
    standard_deviation: Mapped[float | None]
    container_diameter_mm: Mapped[float | None]
    container_height_mm: Mapped[float | None]
    standard: Mapped[str | None]
    date: Mapped[dt.date | None]
    raw_text: Mapped[str]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    aggregate: Mapped[Aggregate | None] = relationship(back_populates="packing_tests")
    mixture: Mapped[Mixture | None] = relationship(back_populates="packing_tests")


class Wish:
    """Columns of what is asked for and computed: who asked when, who works on it, how far it is.

    ``variant``: empty for the method as it is, else a row of the assumption sheet, as ``pair_friction=mean``.
    """

    variant: Mapped[str] = mapped_column(String(64), default="", server_default="")

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
        _one_of("state", STATES),
        CheckConstraint("length(specimen_hash) = 64", name="specimen_hash"),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("repose_angle_deg BETWEEN 0 AND 90", name="repose_angle"),
        CheckConstraint(
            "state <> 'done' OR packing_density IS NOT NULL OR repose_angle_deg IS NOT NULL", name="done_has_result"
        ),
        CheckConstraint("steps >= 0 AND seconds >= 0", name="effort"),
        Index("ix_run_list", *RUN_LIST),
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
        _one_of("state", STATES),
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
        _one_of("state", STATES),
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


class Correction(Base):
    """A typing error corrected: what a row's column held before and after, who changed it and when.

    ``row_key``: the row's primary key, its parts joined by a slash.
    """

    __tablename__ = "correction"
    __table_args__ = (
        _one_of("table_name", CORRECTABLE),
        CheckConstraint("corrected_by <> ''", name="corrected_by"),
        Index(None, "table_name", "row_key"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    table_name: Mapped[str] = mapped_column(String(32))
    row_key: Mapped[str]
    column_name: Mapped[str] = mapped_column(String(32))
    old_value: Mapped[str | None]
    new_value: Mapped[str | None]
    corrected_by: Mapped[str]
    reason: Mapped[str | None]
    corrected_at: Mapped[dt.datetime] = mapped_column(default=now)
