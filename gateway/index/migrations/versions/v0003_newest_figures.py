"""Each figure with its run's machine and time, so that the newest of each machine is found at any size."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
OF_RUN = {"serial": 200, "site": 120, "created_utc": 40}


def upgrade() -> None:
    """Add the columns, fill them from the runs, and index them."""
    for name, length in OF_RUN.items():
        op.add_column("figure", sa.Column(name, sa.String(length), nullable=False, server_default=""))
    run = "FROM run WHERE run.gateway = figure.gateway AND run.run_id = figure.run_id"
    filled = ", ".join(f"{name} = (SELECT run.{name} {run})" for name in OF_RUN)
    op.execute(f"UPDATE figure SET {filled}")  # noqa: S608 - names of columns written above
    op.drop_index("figure_by_subject", table_name="figure")
    op.create_index("figure_by_machine", "figure", ["parameter", "subject", "phase", "serial", "site", "created_utc"])
    op.create_index("figure_by_time", "figure", ["serial", "site", "subject", "created_utc"])


def downgrade() -> None:
    """Take the columns away; the runs have them."""
    op.drop_index("figure_by_machine", table_name="figure")
    op.drop_index("figure_by_time", table_name="figure")
    op.create_index("figure_by_subject", "figure", ["subject", "parameter", "phase"])
    for name in OF_RUN:
        op.drop_column("figure", name)
