"""The tables that pushes left in each machine's control."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Make it."""
    op.create_table(
        "active_table",
        sa.Column("gateway", sa.String(200), primary_key=True),
        sa.Column("serial", sa.String(200), primary_key=True),
        sa.Column("name", sa.String(80), primary_key=True),
        sa.Column("axis", sa.String(40), nullable=False),
        sa.Column("table_id", sa.String(12), nullable=False),
        sa.Column("transaction", sa.BigInteger, nullable=False),
        sa.Column("utc", sa.String(40), nullable=False),
        sa.Column("enabled", sa.Boolean, nullable=False),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("problem", sa.Text, nullable=False),
        sa.Column("seal", sa.String(64), nullable=False),
    )


def downgrade() -> None:
    """Take it away; the journals are in their folders."""
    op.drop_table("active_table")
