"""Several methods and their variants, calibrations by angle of repose, spheres of several sizes; columns for lists."""

import itertools
import math
from collections.abc import Sequence

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
    OR k.table_name = 'sieve_result' AND k.row_key IN (
        SELECT CAST(r.sieve_analysis_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM sieve_result r WHERE r.sieve_analysis_id = c.sieve_analysis_id
    )
"""
OF_MIXTURE = """
    k.table_name = 'mixture_component' AND k.row_key IN (
        SELECT CAST(r.mixture_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM mixture_component r WHERE r.mixture_id = m.id
    )
"""

# a geometric reference rests on the sieve tables alone, and on no calibration
OF_SIEVES = """
    k.table_name = 'sieve_analysis' AND k.row_key = CAST(s.id AS TEXT)
    OR k.table_name = 'sieve_result' AND k.row_key IN (
        SELECT CAST(r.sieve_analysis_id AS TEXT) || '/' || CAST(r.position AS TEXT)
        FROM sieve_result r WHERE r.sieve_analysis_id = s.id
    )
"""
OF_OTHER_SIEVES = f"""EXISTS (
            SELECT 1 FROM mixture_component y JOIN sieve_analysis s
                ON s.id = (SELECT max(x.id) FROM sieve_analysis x WHERE x.aggregate_id = y.aggregate_id)
            WHERE y.mixture_id = m.id
                AND (s.created_at > p.requested_at OR s.version > 1 AND {corrected(OF_SIEVES, "p.requested_at")})
        )"""

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
    s.id AS sieve_analysis_id, s.finest_mm, s.coarsest_mm, s.log_mean_mm, t.id AS packing_test_id, t.compaction,
    {measured(OVEN_DRY)} AS measured_packing_density,
    c.id AS calibration_id, c.state, c.method, c.diameter_rule, c.diameter_mm, c.friction, c.friction_low,
    c.friction_high, c.rolling_friction, c.rolling_friction_low, c.rolling_friction_high, c.engine_version, c.message,
    a.created_at
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

# which aggregates of prediction p were tested or sieved anew, or corrected
OUTDATED = """
            SELECT {join}(o.aggregate, ', ') FROM (
                SELECT o.aggregate FROM prediction_calibration l
                JOIN outdated_calibrations o ON o.calibration_id = l.calibration_id
                WHERE l.prediction_id = p.id ORDER BY l.calibration_id
            ) o
        """


def predicted_vs_measured(join: str) -> str:
    """The newest prediction of each mixture by each method; ``join``: the database's function that joins texts."""
    return f"""
CREATE VIEW predicted_vs_measured AS
SELECT pair.mixture_id, pair.mixture, pair.prediction_id,
    CASE WHEN pair.state = 'done' AND (pair.outdated IS NOT NULL OR pair.corrected) THEN 'outdated' ELSE pair.state END
        AS state,
    pair.method, pair.engine_version, pair.predicted, pair.standard_error, pair.input_error, pair.packing_test_id,
    pair.compaction, pair.measured, pair.message, pair.warnings, pair.outdated, pair.requested_at, pair.finished_at,
    pair.predicted - pair.measured AS difference
FROM (
    SELECT
        m.id AS mixture_id, m.name AS mixture, p.id AS prediction_id, coalesce(p.state, 'open') AS state,
        p.method, p.engine_version, p.packing_density AS predicted, p.standard_error, p.input_error,
        t.id AS packing_test_id, t.compaction,
        {measured(MEAN_DENSITY)} AS measured,
        p.message, p.warnings, ({OUTDATED.format(join=join)}) AS outdated,
        m.version > 1 AND {corrected(OF_MIXTURE, "p.requested_at")}
            OR p.method IN ('static', 'drop_and_roll', 'ordered') AND {OF_OTHER_SIEVES} AS corrected,
        p.requested_at, p.finished_at
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


COMPARISONS = """
INSERT INTO comparison (
    mixture_id, method, mixture, prediction_id, state, engine_version, predicted, standard_error, input_error,
    compaction, measured, difference, message, warnings, outdated, requested_at
)
SELECT
    mixture_id, coalesce(method, ''), mixture, prediction_id, state, engine_version, predicted, standard_error,
    input_error, compaction, measured, difference, message, warnings, outdated, requested_at
FROM predicted_vs_measured
"""

NEWEST_PREDICTION = ["mixture_id", "method", "variant", "requested_at", "id", "state"]


def passing(kind: str, results: Sequence[tuple[float | None, float]]) -> tuple[list[float], list[float]]:
    """The apertures of a sieve analysis, falling, and the share that passes each; an aperture of None is the pan."""
    sieves = sorted((aperture, value) for aperture, value in results if aperture is not None)[::-1]
    apertures = [aperture for aperture, _ in sieves]
    if kind == "passing_percent":
        return apertures, [value / 100.0 for _, value in sieves]
    total = math.fsum(value for _, value in results)
    held = itertools.accumulate(value for _, value in sieves)
    shares = [max(0.0, 1.0 - value / total) for value in held]
    if not any(value for aperture, value in results if aperture is None):
        shares[-1] = 0.0
    return apertures, shares


def sizes(
    kind: str, pan_lower: float | None, results: Sequence[tuple[float | None, float]]
) -> tuple[float, float, float]:
    """The finest and the coarsest size of a sieve analysis and the log-mean diameter [mm], as pdlab has them then."""
    apertures, shares = passing(kind, results)
    if shares[-1] > 0.0:
        apertures, shares = [*apertures, pan_lower or apertures[-1] / 2.0], [*shares, 0.0]
    first = max(k for k, share in enumerate(shares) if share >= 1.0 - 1e-12)
    last = next((k for k, share in enumerate(shares) if share <= 1e-12), len(shares) - 1)
    classes = [
        (coarse - fine, math.log(math.sqrt(above * below)))
        for (coarse, fine), (above, below) in zip(
            itertools.pairwise(shares[first : last + 1]), itertools.pairwise(apertures[first : last + 1]), strict=True
        )
    ]
    return apertures[last], apertures[first], math.exp(math.fsum(share * size for share, size in classes))


def fill_sizes() -> None:
    connection = op.get_bind()
    values = "coalesce(retained_g, retained_percent, passing_percent)"
    query = f"SELECT sieve_analysis_id, aperture_mm, {values} FROM sieve_result ORDER BY sieve_analysis_id, position"
    results = {
        key: [(row[1], row[2]) for row in rows]
        for key, rows in itertools.groupby(connection.exec_driver_sql(query), key=lambda row: row[0])
    }
    update = sa.text("UPDATE sieve_analysis SET finest_mm = :f, coarsest_mm = :c, log_mean_mm = :d WHERE id = :id")
    for key, kind, pan_lower in connection.exec_driver_sql("SELECT id, kind, pan_lower_mm FROM sieve_analysis").all():
        if key in results:
            finest, coarsest, mean = sizes(kind, pan_lower, results[key])
            connection.execute(update, {"f": finest, "c": coarsest, "d": mean, "id": key})


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
    with op.batch_alter_table("packing_test") as batch_op:
        batch_op.add_column(sa.Column("moisture_percent", sa.Double(), nullable=True))
        batch_op.create_check_constraint(
            op.f("ck_packing_test_moisture"), "moisture_percent >= 0 AND moisture_percent < 100"
        )
    op.add_column("prediction", sa.Column("variant", sa.String(length=64), server_default="", nullable=False))
    op.drop_index("ix_prediction_newest", table_name="prediction")
    op.create_index("ix_prediction_newest", "prediction", NEWEST_PREDICTION)
    for column in ("finest_mm", "coarsest_mm", "log_mean_mm"):
        op.add_column("sieve_analysis", sa.Column(column, sa.Double(), nullable=True))
    fill_sizes()
    op.execute(OUTDATED_CALIBRATIONS)
    op.execute(CURRENT_AGGREGATES)
    op.execute(predicted_vs_measured("group_concat" if op.get_bind().dialect.name == "sqlite" else "string_agg"))
    make_comparisons()


def make_comparisons() -> None:
    op.create_table(
        "comparison",
        sa.Column("mixture_id", sa.Integer(), nullable=False),
        sa.Column("method", sa.String(length=32), nullable=False),
        sa.Column("mixture", sa.Text(), nullable=False),
        sa.Column("prediction_id", sa.Integer(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("engine_version", sa.Integer(), nullable=True),
        sa.Column("predicted", sa.Double(), nullable=True),
        sa.Column("standard_error", sa.Double(), nullable=True),
        sa.Column("input_error", sa.Double(), nullable=True),
        sa.Column("compaction", sa.Text(), nullable=True),
        sa.Column("measured", sa.Double(), nullable=True),
        sa.Column("difference", sa.Double(), nullable=True),
        sa.Column("message", sa.Text(), nullable=True),
        sa.Column("warnings", sa.Text(), nullable=True),
        sa.Column("outdated", sa.Text(), nullable=True),
        sa.Column("requested_at", sa.DateTime(), nullable=True),
        sa.ForeignKeyConstraint(
            ["mixture_id"], ["mixture.id"], name=op.f("fk_comparison_mixture_id_mixture"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["prediction_id"], ["prediction.id"], name=op.f("fk_comparison_prediction_id_prediction"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("mixture_id", "method", name=op.f("pk_comparison")),
    )  # fmt: skip
    op.create_index(op.f("ix_comparison_prediction_id"), "comparison", ["prediction_id"])
    spread = ["method", "engine_version", "difference"]
    op.create_index(op.f("ix_comparison_method_engine_version_difference"), "comparison", spread)
    op.execute(COMPARISONS)
