"""The first store: aggregates, their tests, mixtures, runs, calibrations, predictions."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "aggregate",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("delivery", sa.Text(), nullable=False),
        sa.Column("particle_density_kg_m3", sa.Double(), nullable=True),
        sa.Column("density_basis", sa.String(length=16), nullable=True),
        sa.Column("water_absorption_percent", sa.Double(), nullable=True),
        sa.Column("shape", sa.Text(), nullable=True),
        sa.Column("source", sa.Text(), nullable=True),
        sa.Column("repose_angle_deg", sa.Double(), nullable=True),
        sa.Column("wall_angle_deg", sa.Double(), nullable=True),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint(
            "density_basis IS NULL OR density_basis IN ('oven_dry', 'ssd', 'apparent')",
            name=op.f("ck_aggregate_density_basis"),
        ),
        sa.CheckConstraint("name <> ''", name=op.f("ck_aggregate_name")),
        sa.CheckConstraint(
            "(particle_density_kg_m3 IS NULL) = (density_basis IS NULL)", name=op.f("ck_aggregate_density_has_basis")
        ),
        sa.CheckConstraint("particle_density_kg_m3 > 0", name=op.f("ck_aggregate_particle_density")),
        sa.CheckConstraint(
            "water_absorption_percent >= 0 AND water_absorption_percent < 100", name=op.f("ck_aggregate_absorption")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_aggregate")),
        sa.UniqueConstraint("name", "delivery", name=op.f("uq_aggregate_name_delivery")),
    )
    op.create_table(
        "mixture",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint("name <> ''", name=op.f("ck_mixture_name")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_mixture")),
        sa.UniqueConstraint("name", name=op.f("uq_mixture_name")),
    )
    op.create_table(
        "run",
        sa.Column("specimen_hash", sa.String(length=64), nullable=False),
        sa.Column("specimen", sa.Text(), nullable=False),
        sa.Column("engine_version", sa.Integer(), nullable=False),
        sa.Column("numba_version", sa.Text(), nullable=True),
        sa.Column("processor", sa.Text(), nullable=True),
        sa.Column("seed", sa.Integer(), nullable=False),
        sa.Column("spheres", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("packing_density", sa.Double(), nullable=True),
        sa.Column("coordination_number", sa.Double(), nullable=True),
        sa.Column("height", sa.Double(), nullable=True),
        sa.Column("slab_shares", sa.Text(), nullable=True),
        sa.Column("largest_overlap", sa.Double(), nullable=True),
        sa.Column("rest", sa.Text(), nullable=True),
        sa.Column("steps", sa.Integer(), nullable=True),
        sa.Column("seconds", sa.Double(), nullable=True),
        sa.Column("warnings", sa.Text(), nullable=True),
        sa.Column("claimed_by", sa.Text(), nullable=True),
        sa.Column("heartbeat", sa.DateTime(), nullable=True),
        sa.Column("error", sa.Text(), nullable=True),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("finished_at", sa.DateTime(), nullable=True),
        sa.CheckConstraint("state <> 'done' OR packing_density IS NOT NULL", name=op.f("ck_run_done_has_result")),
        sa.CheckConstraint("state IN ('queued', 'running', 'done', 'failed', 'cancelled')", name=op.f("ck_run_state")),
        sa.CheckConstraint("length(specimen_hash) = 64", name=op.f("ck_run_specimen_hash")),
        sa.CheckConstraint("packing_density > 0 AND packing_density < 1", name=op.f("ck_run_packing_density")),
        sa.CheckConstraint("steps >= 0 AND seconds >= 0", name=op.f("ck_run_effort")),
        sa.PrimaryKeyConstraint("specimen_hash", name=op.f("pk_run")),
    )
    with op.batch_alter_table("run", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_run_state"), ["state"], unique=False)

    op.create_table(
        "mixture_component",
        sa.Column("mixture_id", sa.Integer(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("aggregate_id", sa.Integer(), nullable=False),
        sa.Column("solid_volume_share", sa.Double(), nullable=False),
        sa.Column("mass_share", sa.Double(), nullable=True),
        sa.CheckConstraint("mass_share > 0 AND mass_share <= 1", name=op.f("ck_mixture_component_mass_share")),
        sa.CheckConstraint(
            "solid_volume_share > 0 AND solid_volume_share <= 1", name=op.f("ck_mixture_component_solid_volume_share")
        ),
        sa.ForeignKeyConstraint(
            ["aggregate_id"], ["aggregate.id"], name=op.f("fk_mixture_component_aggregate_id_aggregate")
        ),
        sa.ForeignKeyConstraint(["mixture_id"], ["mixture.id"], name=op.f("fk_mixture_component_mixture_id_mixture")),
        sa.PrimaryKeyConstraint("mixture_id", "position", name=op.f("pk_mixture_component")),
        sa.UniqueConstraint("mixture_id", "aggregate_id", name=op.f("uq_mixture_component_mixture_id_aggregate_id")),
    )
    with op.batch_alter_table("mixture_component", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_mixture_component_aggregate_id"), ["aggregate_id"], unique=False)

    op.create_table(
        "packing_test",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("aggregate_id", sa.Integer(), nullable=True),
        sa.Column("mixture_id", sa.Integer(), nullable=True),
        sa.Column("compaction", sa.String(length=16), nullable=False),
        sa.Column("bulk_density_kg_m3", sa.Double(), nullable=True),
        sa.Column("voids_percent", sa.Double(), nullable=True),
        sa.Column("packing_density", sa.Double(), nullable=True),
        sa.Column("repeats", sa.Integer(), nullable=True),
        sa.Column("standard_deviation", sa.Double(), nullable=True),
        sa.Column("container_diameter_mm", sa.Double(), nullable=True),
        sa.Column("container_height_mm", sa.Double(), nullable=True),
        sa.Column("standard", sa.Text(), nullable=True),
        sa.Column("date", sa.Date(), nullable=True),
        sa.Column("raw_text", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint(
            "compaction IN ('loose', 'rodded', 'vibrated', 'unstated')", name=op.f("ck_packing_test_compaction")
        ),
        sa.CheckConstraint("(aggregate_id IS NULL) <> (mixture_id IS NULL)", name=op.f("ck_packing_test_one_material")),
        sa.CheckConstraint(
            "CASE WHEN bulk_density_kg_m3 IS NULL THEN 0 ELSE 1 END + CASE WHEN voids_percent IS NULL THEN 0 ELSE 1 END + CASE WHEN packing_density IS NULL THEN 0 ELSE 1 END = 1",
            name=op.f("ck_packing_test_one_value"),
        ),
        sa.CheckConstraint("bulk_density_kg_m3 > 0", name=op.f("ck_packing_test_bulk_density")),
        sa.CheckConstraint(
            "container_diameter_mm > 0 AND container_height_mm > 0", name=op.f("ck_packing_test_container")
        ),
        sa.CheckConstraint("packing_density > 0 AND packing_density < 1", name=op.f("ck_packing_test_packing_density")),
        sa.CheckConstraint("repeats >= 1", name=op.f("ck_packing_test_repeats")),
        sa.CheckConstraint("standard_deviation >= 0", name=op.f("ck_packing_test_standard_deviation")),
        sa.CheckConstraint("voids_percent > 0 AND voids_percent < 100", name=op.f("ck_packing_test_voids")),
        sa.ForeignKeyConstraint(
            ["aggregate_id"], ["aggregate.id"], name=op.f("fk_packing_test_aggregate_id_aggregate")
        ),
        sa.ForeignKeyConstraint(["mixture_id"], ["mixture.id"], name=op.f("fk_packing_test_mixture_id_mixture")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_packing_test")),
    )
    with op.batch_alter_table("packing_test", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_packing_test_aggregate_id"), ["aggregate_id"], unique=False)
        batch_op.create_index(batch_op.f("ix_packing_test_mixture_id"), ["mixture_id"], unique=False)

    op.create_table(
        "prediction",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("mixture_id", sa.Integer(), nullable=False),
        sa.Column("method", sa.String(length=32), nullable=False),
        sa.Column("protocol", sa.Text(), nullable=False),
        sa.Column("engine_version", sa.Integer(), nullable=True),
        sa.Column("packing_density", sa.Double(), nullable=True),
        sa.Column("standard_error", sa.Double(), nullable=True),
        sa.Column("input_error", sa.Double(), nullable=True),
        sa.Column("warnings", sa.Text(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("requested_at", sa.DateTime(), nullable=False),
        sa.Column("finished_at", sa.DateTime(), nullable=True),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("message", sa.Text(), nullable=True),
        sa.Column("claimed_by", sa.Text(), nullable=True),
        sa.Column("heartbeat", sa.DateTime(), nullable=True),
        sa.CheckConstraint(
            "state <> 'done' OR packing_density IS NOT NULL", name=op.f("ck_prediction_done_has_result")
        ),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'done', 'failed', 'cancelled')", name=op.f("ck_prediction_state")
        ),
        sa.CheckConstraint("packing_density > 0 AND packing_density < 1", name=op.f("ck_prediction_packing_density")),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name=op.f("ck_prediction_progress")),
        sa.CheckConstraint("standard_error >= 0 AND input_error >= 0", name=op.f("ck_prediction_errors")),
        sa.ForeignKeyConstraint(["mixture_id"], ["mixture.id"], name=op.f("fk_prediction_mixture_id_mixture")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_prediction")),
    )
    with op.batch_alter_table("prediction", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_prediction_mixture_id"), ["mixture_id"], unique=False)
        batch_op.create_index(batch_op.f("ix_prediction_state"), ["state"], unique=False)

    op.create_table(
        "run_state",
        sa.Column("specimen_hash", sa.String(length=64), nullable=False),
        sa.Column("steps", sa.Integer(), nullable=False),
        sa.Column("archive", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["specimen_hash"], ["run.specimen_hash"], name=op.f("fk_run_state_specimen_hash_run"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("specimen_hash", name=op.f("pk_run_state")),
    )
    op.create_table(
        "sieve_analysis",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("aggregate_id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("sample_mass_g", sa.Double(), nullable=True),
        sa.Column("pan_lower_mm", sa.Double(), nullable=True),
        sa.Column("standard", sa.Text(), nullable=True),
        sa.Column("date", sa.Date(), nullable=True),
        sa.Column("raw_text", sa.Text(), nullable=True),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint(
            "kind IN ('retained_g', 'retained_percent', 'passing_percent')", name=op.f("ck_sieve_analysis_kind")
        ),
        sa.CheckConstraint("pan_lower_mm > 0", name=op.f("ck_sieve_analysis_pan_lower")),
        sa.CheckConstraint("sample_mass_g > 0", name=op.f("ck_sieve_analysis_sample_mass")),
        sa.ForeignKeyConstraint(
            ["aggregate_id"], ["aggregate.id"], name=op.f("fk_sieve_analysis_aggregate_id_aggregate")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sieve_analysis")),
    )
    with op.batch_alter_table("sieve_analysis", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_sieve_analysis_aggregate_id"), ["aggregate_id"], unique=False)

    op.create_table(
        "calibration",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("aggregate_id", sa.Integer(), nullable=False),
        sa.Column("sieve_analysis_id", sa.Integer(), nullable=False),
        sa.Column("packing_test_id", sa.Integer(), nullable=False),
        sa.Column("method", sa.String(length=32), nullable=False),
        sa.Column("protocol", sa.Text(), nullable=False),
        sa.Column("engine_version", sa.Integer(), nullable=True),
        sa.Column("diameter_rule", sa.String(length=32), nullable=False),
        sa.Column("diameter_mm", sa.Double(), nullable=False),
        sa.Column("measured_packing_density", sa.Double(), nullable=False),
        sa.Column("friction", sa.Double(), nullable=True),
        sa.Column("friction_low", sa.Double(), nullable=True),
        sa.Column("friction_high", sa.Double(), nullable=True),
        sa.Column("rolling_friction", sa.Double(), nullable=True),
        sa.Column("packing_density", sa.Double(), nullable=True),
        sa.Column("input_error", sa.Double(), nullable=True),
        sa.Column("curve_error", sa.Double(), nullable=True),
        sa.Column("warnings", sa.Text(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("requested_at", sa.DateTime(), nullable=False),
        sa.Column("finished_at", sa.DateTime(), nullable=True),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("message", sa.Text(), nullable=True),
        sa.Column("claimed_by", sa.Text(), nullable=True),
        sa.Column("heartbeat", sa.DateTime(), nullable=True),
        sa.CheckConstraint("state <> 'done' OR friction IS NOT NULL", name=op.f("ck_calibration_done_has_result")),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'done', 'failed', 'cancelled')", name=op.f("ck_calibration_state")
        ),
        sa.CheckConstraint("diameter_mm > 0", name=op.f("ck_calibration_diameter")),
        sa.CheckConstraint(
            "friction >= 0 AND friction_low >= 0 AND friction_high >= 0", name=op.f("ck_calibration_friction")
        ),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name=op.f("ck_calibration_progress")),
        sa.ForeignKeyConstraint(["aggregate_id"], ["aggregate.id"], name=op.f("fk_calibration_aggregate_id_aggregate")),
        sa.ForeignKeyConstraint(
            ["packing_test_id"], ["packing_test.id"], name=op.f("fk_calibration_packing_test_id_packing_test")
        ),
        sa.ForeignKeyConstraint(
            ["sieve_analysis_id"], ["sieve_analysis.id"], name=op.f("fk_calibration_sieve_analysis_id_sieve_analysis")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_calibration")),
    )
    with op.batch_alter_table("calibration", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_calibration_aggregate_id"), ["aggregate_id"], unique=False)
        batch_op.create_index(batch_op.f("ix_calibration_state"), ["state"], unique=False)

    op.create_table(
        "prediction_run",
        sa.Column("prediction_id", sa.Integer(), nullable=False),
        sa.Column("specimen_hash", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(
            ["prediction_id"], ["prediction.id"], name=op.f("fk_prediction_run_prediction_id_prediction")
        ),
        sa.ForeignKeyConstraint(
            ["specimen_hash"], ["run.specimen_hash"], name=op.f("fk_prediction_run_specimen_hash_run")
        ),
        sa.PrimaryKeyConstraint("prediction_id", "specimen_hash", name=op.f("pk_prediction_run")),
    )
    with op.batch_alter_table("prediction_run", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_prediction_run_specimen_hash"), ["specimen_hash"], unique=False)

    op.create_table(
        "sieve_result",
        sa.Column("sieve_analysis_id", sa.Integer(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("aperture_mm", sa.Double(), nullable=True),
        sa.Column("retained_g", sa.Double(), nullable=True),
        sa.Column("retained_percent", sa.Double(), nullable=True),
        sa.Column("passing_percent", sa.Double(), nullable=True),
        sa.Column("raw_text", sa.Text(), nullable=False),
        sa.CheckConstraint(
            "CASE WHEN retained_g IS NULL THEN 0 ELSE 1 END + CASE WHEN retained_percent IS NULL THEN 0 ELSE 1 END + CASE WHEN passing_percent IS NULL THEN 0 ELSE 1 END = 1",
            name=op.f("ck_sieve_result_one_value"),
        ),
        sa.CheckConstraint("aperture_mm > 0", name=op.f("ck_sieve_result_aperture")),
        sa.CheckConstraint("passing_percent BETWEEN 0 AND 100", name=op.f("ck_sieve_result_passing_percent")),
        sa.CheckConstraint("retained_g >= 0", name=op.f("ck_sieve_result_retained_g")),
        sa.CheckConstraint("retained_percent BETWEEN 0 AND 100", name=op.f("ck_sieve_result_retained_percent")),
        sa.ForeignKeyConstraint(
            ["sieve_analysis_id"], ["sieve_analysis.id"], name=op.f("fk_sieve_result_sieve_analysis_id_sieve_analysis")
        ),
        sa.PrimaryKeyConstraint("sieve_analysis_id", "position", name=op.f("pk_sieve_result")),
        sa.UniqueConstraint(
            "sieve_analysis_id", "aperture_mm", name=op.f("uq_sieve_result_sieve_analysis_id_aperture_mm")
        ),
    )
    op.create_table(
        "calibration_run",
        sa.Column("calibration_id", sa.Integer(), nullable=False),
        sa.Column("specimen_hash", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibration.id"], name=op.f("fk_calibration_run_calibration_id_calibration")
        ),
        sa.ForeignKeyConstraint(
            ["specimen_hash"], ["run.specimen_hash"], name=op.f("fk_calibration_run_specimen_hash_run")
        ),
        sa.PrimaryKeyConstraint("calibration_id", "specimen_hash", name=op.f("pk_calibration_run")),
    )
    with op.batch_alter_table("calibration_run", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_calibration_run_specimen_hash"), ["specimen_hash"], unique=False)

    op.create_table(
        "prediction_calibration",
        sa.Column("prediction_id", sa.Integer(), nullable=False),
        sa.Column("calibration_id", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibration.id"], name=op.f("fk_prediction_calibration_calibration_id_calibration")
        ),
        sa.ForeignKeyConstraint(
            ["prediction_id"], ["prediction.id"], name=op.f("fk_prediction_calibration_prediction_id_prediction")
        ),
        sa.PrimaryKeyConstraint("prediction_id", "calibration_id", name=op.f("pk_prediction_calibration")),
    )
    with op.batch_alter_table("prediction_calibration", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_prediction_calibration_calibration_id"), ["calibration_id"], unique=False)


def downgrade() -> None:
    with op.batch_alter_table("prediction_calibration", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_prediction_calibration_calibration_id"))

    op.drop_table("prediction_calibration")
    with op.batch_alter_table("calibration_run", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_calibration_run_specimen_hash"))

    op.drop_table("calibration_run")
    op.drop_table("sieve_result")
    with op.batch_alter_table("prediction_run", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_prediction_run_specimen_hash"))

    op.drop_table("prediction_run")
    with op.batch_alter_table("calibration", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_calibration_state"))
        batch_op.drop_index(batch_op.f("ix_calibration_aggregate_id"))

    op.drop_table("calibration")
    with op.batch_alter_table("sieve_analysis", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_sieve_analysis_aggregate_id"))

    op.drop_table("sieve_analysis")
    op.drop_table("run_state")
    with op.batch_alter_table("prediction", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_prediction_state"))
        batch_op.drop_index(batch_op.f("ix_prediction_mixture_id"))

    op.drop_table("prediction")
    with op.batch_alter_table("packing_test", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_packing_test_mixture_id"))
        batch_op.drop_index(batch_op.f("ix_packing_test_aggregate_id"))

    op.drop_table("packing_test")
    with op.batch_alter_table("mixture_component", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_mixture_component_aggregate_id"))

    op.drop_table("mixture_component")
    with op.batch_alter_table("run", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_run_state"))

    op.drop_table("run")
    op.drop_table("mixture")
    op.drop_table("aggregate")
