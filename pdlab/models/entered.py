"""What people entered: aggregates, mixtures, their tests, and every correction of them."""

import datetime as dt
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, declared_attr, mapped_column, relationship

from pdlab.models.columns import Base, exactly_one, now, one_of

DRAFTED = ("aggregate", "mixture")
CORRECTABLE = ("aggregate", "sieve_analysis", "sieve_result", "packing_test", "mixture", "mixture_component")


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
        one_of("density_basis", ("oven_dry", "ssd", "apparent"), optional=True),
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
    """One sieve test of an aggregate; the newest is the current one.

    The ends of its grading and its log-mean diameter are worked out from the results and kept for the lists.
    """

    __tablename__ = "sieve_analysis"
    __table_args__ = (
        CheckConstraint("sample_mass_g > 0", name="sample_mass"),
        CheckConstraint("pan_lower_mm > 0", name="pan_lower"),
        one_of("kind", ("retained_g", "retained_percent", "passing_percent")),
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
    finest_mm: Mapped[float | None]
    coarsest_mm: Mapped[float | None]
    log_mean_mm: Mapped[float | None]
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
        exactly_one("retained_g", "retained_percent", "passing_percent"),
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
        one_of("compaction", ("loose", "rodded", "vibrated", "unstated")),
        exactly_one("bulk_density_kg_m3", "voids_percent", "packing_density"),
        CheckConstraint("bulk_density_kg_m3 > 0", name="bulk_density"),
        CheckConstraint("voids_percent > 0 AND voids_percent < 100", name="voids"),
        CheckConstraint("packing_density > 0 AND packing_density < 1", name="packing_density"),
        CheckConstraint("repeats >= 1", name="repeats"),
        CheckConstraint("standard_deviation >= 0", name="standard_deviation"),
        CheckConstraint("container_diameter_mm > 0 AND container_height_mm > 0", name="container"),
        CheckConstraint("moisture_percent >= 0 AND moisture_percent < 100", name="moisture"),
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
    moisture_percent: Mapped[float | None]
    standard: Mapped[str | None]
    date: Mapped[dt.date | None]
    raw_text: Mapped[str]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    aggregate: Mapped[Aggregate | None] = relationship(back_populates="packing_tests")
    mixture: Mapped[Mixture | None] = relationship(back_populates="packing_tests")


class Correction(Base):
    """A typing error corrected: what a row's column held before and after, who changed it and when.

    ``row_key``: the row's primary key, its parts joined by a slash.
    """

    __tablename__ = "correction"
    __table_args__ = (
        one_of("table_name", CORRECTABLE),
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


class Draft(Base):
    """What somebody is entering and has not saved yet, as JSON of the texts that stand in the form."""

    __tablename__ = "draft"
    __table_args__ = (one_of("kind", DRAFTED),)
    id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str] = mapped_column(String(16))
    content: Mapped[str]
    created_at: Mapped[dt.datetime] = mapped_column(default=now)
    saved_at: Mapped[dt.datetime] = mapped_column(default=now)
