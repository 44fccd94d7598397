"""Corrections that keep the old value, versions of what people edit, two views."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

EDITED = ("aggregate", "sieve_analysis", "mixture", "packing_test")

OVEN_DRY = """CASE a.density_basis
        WHEN 'oven_dry' THEN a.particle_density_kg_m3
        WHEN 'ssd' THEN a.particle_density_kg_m3 / (1.0 + a.water_absorption_percent / 100.0)
        WHEN 'apparent' THEN 1.0 / (1.0 / a.particle_density_kg_m3 + a.water_absorption_percent / 100.0 / 997.5)
    END"""

CURRENT_AGGREGATES = f"""
CREATE VIEW current_aggregates AS
SELECT
    a.id AS aggregate_id, a.name, a.delivery, a.source, a.shape,
    {OVEN_DRY} AS oven_dry_density_kg_m3,
    s.id AS sieve_analysis_id, t.id AS packing_test_id, t.compaction,
    CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / ({OVEN_DRY})
    END AS measured_packing_density,
    c.id AS calibration_id, c.method, c.diameter_rule, c.diameter_mm, c.friction, c.friction_low, c.friction_high,
    c.engine_version, a.created_at
FROM aggregate a
LEFT JOIN sieve_analysis s ON s.id = (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = a.id)
LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.aggregate_id = a.id)
LEFT JOIN calibration c ON c.id = (
    SELECT x.id FROM calibration x
    WHERE x.aggregate_id = a.id AND x.state = 'done' AND x.sieve_analysis_id = s.id AND x.packing_test_id = t.id
    ORDER BY x.requested_at DESC, x.id DESC LIMIT 1
)
WHERE a.id = (SELECT max(x.id) FROM aggregate x WHERE x.name = a.name)
"""

PREDICTED_VS_MEASURED = f"""
CREATE VIEW predicted_vs_measured AS
SELECT
    m.id AS mixture_id, m.name AS mixture, p.id AS prediction_id, p.method, p.engine_version,
    p.packing_density AS predicted, p.standard_error, p.input_error,
    t.id AS packing_test_id, t.compaction,
    CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / (
            SELECT CASE WHEN count(*) = count({OVEN_DRY})
                THEN sum(k.solid_volume_share * ({OVEN_DRY})) / sum(k.solid_volume_share) END
            FROM mixture_component k JOIN aggregate a ON a.id = k.aggregate_id WHERE k.mixture_id = m.id
        )
    END AS measured,
    p.packing_density - CASE
        WHEN t.packing_density IS NOT NULL THEN t.packing_density
        WHEN t.voids_percent IS NOT NULL THEN 1.0 - t.voids_percent / 100.0
        ELSE t.bulk_density_kg_m3 / (
            SELECT CASE WHEN count(*) = count({OVEN_DRY})
                THEN sum(k.solid_volume_share * ({OVEN_DRY})) / sum(k.solid_volume_share) END
            FROM mixture_component k JOIN aggregate a ON a.id = k.aggregate_id WHERE k.mixture_id = m.id
        )
    END AS difference,
    p.requested_at, p.finished_at
FROM mixture m
JOIN prediction p ON p.mixture_id = m.id AND p.id = (
    SELECT x.id FROM prediction x
    WHERE x.mixture_id = m.id AND x.method = p.method AND x.state = 'done'
    ORDER BY x.requested_at DESC, x.id DESC LIMIT 1
)
LEFT JOIN packing_test t ON t.id = (SELECT max(x.id) FROM packing_test x WHERE x.mixture_id = m.id)
"""


def upgrade() -> None:
    op.create_table(
        "correction",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("table_name", sa.String(length=32), nullable=False),
        sa.Column("row_key", sa.Text(), nullable=False),
        sa.Column("column_name", sa.String(length=32), nullable=False),
        sa.Column("old_value", sa.Text(), nullable=True),
        sa.Column("new_value", sa.Text(), nullable=True),
        sa.Column("corrected_by", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=True),
        sa.Column("corrected_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint(
            "table_name IN ('aggregate', 'sieve_analysis', 'sieve_result', 'packing_test', 'mixture', "
            "'mixture_component')",
            name=op.f("ck_correction_table_name"),
        ),
        sa.CheckConstraint("corrected_by <> ''", name=op.f("ck_correction_corrected_by")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_correction")),
    )
    op.create_index(op.f("ix_correction_table_name_row_key"), "correction", ["table_name", "row_key"])
    for table in EDITED:
        op.add_column(table, sa.Column("version", sa.Integer(), server_default="1", nullable=False))
    op.create_index(op.f("ix_prediction_mixture_id_requested_at"), "prediction", ["mixture_id", "requested_at"])
    op.execute(CURRENT_AGGREGATES)
    op.execute(PREDICTED_VS_MEASURED)


def downgrade() -> None:
    op.execute("DROP VIEW predicted_vs_measured")
    op.execute("DROP VIEW current_aggregates")
    op.drop_index(op.f("ix_prediction_mixture_id_requested_at"), table_name="prediction")
    for table in EDITED:
        with op.batch_alter_table(table) as batch_op:
            batch_op.drop_column("version")
    op.drop_table("correction")
