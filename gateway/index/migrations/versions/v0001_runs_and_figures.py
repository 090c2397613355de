"""The first tables: runs and their figures."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make them."""
    op.create_table(
        "run",
        sa.Column("gateway", sa.String(200), primary_key=True),
        sa.Column("run_id", sa.String(120), primary_key=True),
        sa.Column("site", sa.String(120), nullable=False),
        sa.Column("serial", sa.String(200), nullable=False),
        sa.Column("created_utc", sa.String(40), nullable=False),
        sa.Column("state", sa.String(80), nullable=False),
        sa.Column("software", sa.String(40), nullable=False),
        sa.Column("problem", sa.Text, nullable=False),
        sa.Column("seal", sa.String(64), nullable=False),
    )
    op.create_index("run_by_machine", "run", ["serial", "created_utc"])
    op.create_table(
        "figure",
        sa.Column("gateway", sa.String(200), primary_key=True),
        sa.Column("run_id", sa.String(120), primary_key=True),
        sa.Column("subject", sa.String(40), primary_key=True),
        sa.Column("phase", sa.String(20), primary_key=True),
        sa.Column("parameter", sa.String(20), primary_key=True),
        sa.Column("value", sa.Float, nullable=False),
        sa.Column("expanded", sa.Float, nullable=True),
        sa.Column("unit", sa.String(20), nullable=False),
        sa.ForeignKeyConstraint(["gateway", "run_id"], ["run.gateway", "run.run_id"], ondelete="CASCADE"),
    )
    op.create_index("figure_by_subject", "figure", ["subject", "parameter", "phase"])


def downgrade() -> None:
    """Take them away; the runs themselves are in their folders."""
    op.drop_table("figure")
    op.drop_table("run")
