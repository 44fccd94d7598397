"""What was asked for with a wish, sweeps along proportions, drafts of what people enter."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

STATES = "state IN ('queued', 'running', 'done', 'failed', 'cancelled')"


def upgrade() -> None:
    for table in ("calibration", "prediction"):
        op.add_column(table, sa.Column("asked", sa.Text(), nullable=True))
    make_sweeps()
    op.create_table(
        "draft",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("content", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("saved_at", sa.DateTime(), nullable=False),
        sa.CheckConstraint("kind IN ('aggregate', 'mixture')", name=op.f("ck_draft_kind")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_draft")),
    )


def make_sweeps() -> None:
    op.create_table(
        "sweep",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("method", sa.String(length=32), nullable=False),
        sa.Column("asked", sa.Text(), nullable=True),
        sa.Column("wished_error", sa.Double(), nullable=False),
        sa.Column("most_specimens", sa.Integer(), nullable=False),
        sa.Column("engine_version", sa.Integer(), nullable=True),
        sa.Column("packing_density", sa.Double(), nullable=True),
        sa.Column("standard_error", sa.Double(), nullable=True),
        sa.Column("input_error", sa.Double(), nullable=True),
        sa.Column("curve", sa.Text(), nullable=True),
        sa.Column("warnings", sa.Text(), nullable=True),
        sa.Column("variant", sa.String(length=64), server_default="", nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("requested_at", sa.DateTime(), nullable=False),
        sa.Column("finished_at", sa.DateTime(), nullable=True),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("message", sa.Text(), nullable=True),
        sa.Column("claimed_by", sa.Text(), nullable=True),
        sa.Column("heartbeat", sa.DateTime(), nullable=True),
        sa.CheckConstraint(STATES, name=op.f("ck_sweep_state")),
        sa.CheckConstraint("packing_density > 0 AND packing_density < 1", name=op.f("ck_sweep_packing_density")),
        sa.CheckConstraint("standard_error >= 0 AND input_error >= 0", name=op.f("ck_sweep_errors")),
        sa.CheckConstraint("wished_error > 0 AND most_specimens > 0", name=op.f("ck_sweep_wished")),
        sa.CheckConstraint("state <> 'done' OR packing_density IS NOT NULL", name=op.f("ck_sweep_done_has_result")),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name=op.f("ck_sweep_progress")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sweep")),
    )
    op.create_index(op.f("ix_sweep_state"), "sweep", ["state"])
    op.create_table(
        "sweep_component",
        sa.Column("sweep_id", sa.Integer(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("aggregate_id", sa.Integer(), nullable=False),
        sa.Column("densest_share", sa.Double(), nullable=True),
        sa.Column("next_share", sa.Double(), nullable=True),
        sa.CheckConstraint("densest_share BETWEEN 0 AND 1", name=op.f("ck_sweep_component_densest_share")),
        sa.CheckConstraint("next_share BETWEEN 0 AND 1", name=op.f("ck_sweep_component_next_share")),
        sa.ForeignKeyConstraint(["sweep_id"], ["sweep.id"], name=op.f("fk_sweep_component_sweep_id_sweep")),
        sa.ForeignKeyConstraint(
            ["aggregate_id"], ["aggregate.id"], name=op.f("fk_sweep_component_aggregate_id_aggregate")
        ),
        sa.PrimaryKeyConstraint("sweep_id", "position", name=op.f("pk_sweep_component")),
    )
    op.create_index(op.f("ix_sweep_component_aggregate_id"), "sweep_component", ["aggregate_id"])
    for what, kind, key in (("run", sa.String(length=64), "specimen_hash"), ("calibration", sa.Integer(), "id")):
        column = key if what == "run" else "calibration_id"
        op.create_table(
            f"sweep_{what}",
            sa.Column("sweep_id", sa.Integer(), nullable=False),
            sa.Column(column, kind, nullable=False),
            sa.ForeignKeyConstraint(["sweep_id"], ["sweep.id"], name=op.f(f"fk_sweep_{what}_sweep_id_sweep")),
            sa.ForeignKeyConstraint([column], [f"{what}.{key}"], name=op.f(f"fk_sweep_{what}_{column}_{what}")),
            sa.PrimaryKeyConstraint("sweep_id", column, name=op.f(f"pk_sweep_{what}")),
        )
        op.create_index(op.f(f"ix_sweep_{what}_{column}"), f"sweep_{what}", [column])
