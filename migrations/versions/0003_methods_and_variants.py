"""Several methods and their variants, calibrations by angle of repose, spheres of several sizes."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

VIEWS = ("predicted_vs_measured", "current_aggregates", "outdated_calibrations")

OVEN_DRY = """CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END"""


def measured(density: str) -> str:
    """What density test t says of the packing density, with an oven-dry particle density [kg/m³]."""
    return f"""CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / ({density})
    END"""


# what a result changes with; names, sources and remarks do not count
ANGLES = ("repose_angle_deg", "wall_angle_deg")
NUMBERS = (
    *ANGLES, "particle_density_kg_m3", "density_basis", "water_absorption_percent", "kind", "sample_mass_g",
    "pan_lower_mm", "aperture_mm", "retained_g", "retained_percent", "passing_percent", "compaction",
    "bulk_density_kg_m3", "voids_percent", "packing_density", "repeats", "standard_deviation", "solid_volume_share",
)  # fmt: skip


def corrected(rows: str, since: str) -> str:
    """Whether a number in some rows was corrected since then and not put back."""
    same = "{0}.table_name = k.table_name AND {0}.row_key = k.row_key AND {0}.column_name = k.column_name"
    return f"""EXISTS (
        SELECT 1 FROM correction k
        WHERE k.corrected_at > {since} AND ({rows}) AND k.column_name IN {NUMBERS}
            AND NOT EXISTS (
                SELECT 1 FROM correction e WHERE {same.format("e")} AND e.id < k.id AND e.corrected_at > {since}
            )
            AND coalesce(k.old_value, '') <> coalesce(
                (SELECT n.new_value FROM correction n WHERE {same.format("n")} ORDER BY n.id DESC LIMIT 1), ''
            )
    )"""


# a calibration rests on a density test, on the angles, or on both
OF_CALIBRATION = f"""
    k.table_name = 'aggregate' AND k.row_key = CAST(c.aggregate_id AS TEXT) AND (
        c.measured_angle_deg IS NOT NULL AND k.column_name IN {ANGLES}
        OR c.packing_test_id IS NOT NULL AND k.column_name NOT IN {ANGLES}
    )
    OR k.table_name = 'packing_test' AND k.row_key = CAST(c.packing_test_id AS TEXT)
    OR k.table_name = 'sieve_analysis' AND k.row_key = CAST(c.sieve_analysis_id AS TEXT)
    OR k.table_name = 'sieve_result' AND k.row_key LIKE CAST(c.sieve_analysis_id AS TEXT) || '/%'
"""
OF_MIXTURE = "k.table_name = 'mixture_component' AND k.row_key LIKE CAST(m.id AS TEXT) || '/%'"

OUTDATED_CALIBRATIONS = f"""
CREATE VIEW outdated_calibrations AS
SELECT c.id AS calibration_id, a.id AS aggregate_id, a.name AS aggregate
FROM calibration c JOIN aggregate a ON a.id = c.aggregate_id
WHERE c.sieve_analysis_id <> (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = c.aggregate_id)
    OR c.packing_test_id <> (SELECT max(x.id) FROM packing_test x WHERE x.aggregate_id = c.aggregate_id)
    OR {corrected(OF_CALIBRATION, "c.requested_at")}
"""

# the last one asked for counts, also where it failed, unless it is outdated or a variant
CURRENT_AGGREGATES = f"""
CREATE VIEW current_aggregates AS
SELECT
    a.id AS aggregate_id, a.name, a.delivery, a.source, a.shape,
    {OVEN_DRY} AS oven_dry_density_kg_m3,
    s.id AS sieve_analysis_id, t.id AS packing_test_id, t.compaction,
    {measured(OVEN_DRY)} AS measured_packing_density,
    c.id AS calibration_id, c.state, c.method, c.diameter_rule, c.diameter_mm, c.friction, c.friction_low,
    c.friction_high, c.engine_version, c.message, a.created_at
FROM aggregate a
LEFT JOIN sieve_analysis s ON s.id = (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = a.id)
LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.aggregate_id = a.id)
LEFT JOIN calibration c ON c.id = (
    SELECT x.id FROM calibration x
    WHERE x.aggregate_id = a.id AND x.variant = '' AND x.state IN ('done', 'failed')
        AND x.id NOT IN (SELECT calibration_id FROM outdated_calibrations)
    ORDER BY x.requested_at DESC, x.id DESC LIMIT 1
)
WHERE a.id = (SELECT max(x.id) FROM aggregate x WHERE x.name = a.name)
"""

# by solid volume, and none where one aggregate's is unknown
MEAN_DENSITY = f"""
            SELECT CASE WHEN count(*) = count({OVEN_DRY})
                THEN sum(k.solid_volume_share * ({OVEN_DRY})) / sum(k.solid_volume_share) END
            FROM mixture_component k JOIN aggregate a ON a.id = k.aggregate_id WHERE k.mixture_id = m.id
        """

# SQLite finds what stands in IN once for all rows; the plus keeps it from looking up each of them for each row
PREDICTED_VS_MEASURED = f"""
CREATE VIEW predicted_vs_measured AS
SELECT pair.*, pair.predicted - pair.measured AS difference
FROM (
    SELECT
        m.id AS mixture_id, m.name AS mixture, p.id AS prediction_id,
        CASE
            WHEN p.state = 'done' AND (EXISTS (
                SELECT 1 FROM prediction_calibration l
                WHERE l.prediction_id = p.id
                    AND +l.calibration_id IN (SELECT calibration_id FROM outdated_calibrations)
            ) OR {corrected(OF_MIXTURE, "p.requested_at")}) THEN 'outdated'
            ELSE coalesce(p.state, 'open')
        END AS state,
        p.method, p.engine_version, p.packing_density AS predicted, p.standard_error, p.input_error,
        t.id AS packing_test_id, t.compaction,
        {measured(MEAN_DENSITY)} AS measured,
        p.message, p.warnings, p.requested_at, p.finished_at
    FROM mixture m
    LEFT JOIN prediction p ON p.mixture_id = m.id AND p.variant = '' AND p.state IN ('done', 'failed')
        AND NOT EXISTS (
            SELECT 1 FROM prediction x
            WHERE x.mixture_id = p.mixture_id AND x.method = p.method AND x.variant = ''
                AND x.state IN ('done', 'failed') AND (x.requested_at, x.id) > (p.requested_at, p.id)
        )
    LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.mixture_id = m.id)
) pair
"""

NEWEST_PREDICTION = ["mixture_id", "method", "variant", "requested_at", "id", "state"]


def upgrade() -> None:
    for view in VIEWS:
        op.execute(f"DROP VIEW {view}")
    with op.batch_alter_table("run") as batch_op:
        batch_op.add_column(sa.Column("repose_angle_deg", sa.Double(), nullable=True))
        batch_op.create_check_constraint(op.f("ck_run_repose_angle"), "repose_angle_deg BETWEEN 0 AND 90")
        batch_op.drop_constraint(op.f("ck_run_done_has_result"), type_="check")
        batch_op.create_check_constraint(
            op.f("ck_run_done_has_result"),
            "state <> 'done' OR packing_density IS NOT NULL OR repose_angle_deg IS NOT NULL",
        )
    with op.batch_alter_table("calibration") as batch_op:
        batch_op.add_column(sa.Column("variant", sa.String(length=64), server_default="", nullable=False))
        batch_op.add_column(sa.Column("spheres", sa.Text(), nullable=True))
        for column in (
            "leave_out_below_mm", "measured_angle_deg", "wall_friction", "rolling_friction_low", "rolling_friction_high",
        ):  # fmt: skip
            batch_op.add_column(sa.Column(column, sa.Double(), nullable=True))
        batch_op.alter_column("packing_test_id", existing_type=sa.Integer(), nullable=True)
        batch_op.alter_column("measured_packing_density", existing_type=sa.Double(), nullable=True)
        batch_op.create_check_constraint(op.f("ck_calibration_leave_out_below"), "leave_out_below_mm > 0")
        batch_op.create_check_constraint(op.f("ck_calibration_measured_angle"), "measured_angle_deg BETWEEN 0 AND 90")
        batch_op.create_check_constraint(op.f("ck_calibration_wall_friction"), "wall_friction >= 0")
        batch_op.create_check_constraint(
            op.f("ck_calibration_rolling_friction"),
            "rolling_friction >= 0 AND rolling_friction_low >= 0 AND rolling_friction_high >= 0",
        )
    op.add_column("prediction", sa.Column("variant", sa.String(length=64), server_default="", nullable=False))
    op.drop_index("ix_prediction_newest", table_name="prediction")
    op.create_index("ix_prediction_newest", "prediction", NEWEST_PREDICTION)
    for view in (OUTDATED_CALIBRATIONS, CURRENT_AGGREGATES, PREDICTED_VS_MEASURED):
        op.execute(view)
