"""The compaction of a prediction's beds beside that of its mixture's test: other ones are no measure of the method."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

OF_METHOD = ["method", "engine_version", "difference"]
OF_COMPACTION = ["method", "engine_version", "simulated", "compaction", "difference"]
WAYS = ("loose", "rodded", "vibrated")
SIMULATED = " ".join(f"""WHEN p.protocol LIKE '%"compaction": "{way}"%' THEN '{way}'""" for way in WAYS)


def upgrade() -> None:
    op.add_column("comparison", sa.Column("simulated", sa.Text(), nullable=True))
    op.execute(
        "UPDATE comparison SET simulated = "
        f"(SELECT CASE {SIMULATED} END FROM prediction p WHERE p.id = comparison.prediction_id)"
    )
    op.drop_index(op.f("ix_comparison_method_engine_version_difference"), "comparison")
    op.create_index("ix_comparison_spread", "comparison", OF_COMPACTION)


def downgrade() -> None:
    op.drop_index("ix_comparison_spread", "comparison")
    op.create_index(op.f("ix_comparison_method_engine_version_difference"), "comparison", OF_METHOD)
    op.drop_column("comparison", "simulated")
