"""The tables of the index as today's program knows them; `migrations` brings older ones here."""

from __future__ import annotations

from sqlalchemy import BigInteger, Boolean, Column, Float, ForeignKeyConstraint, Index, MetaData, String, Table, Text

METADATA = MetaData()
_RUN = (
    Column("gateway", String(200), primary_key=True),
    Column("run_id", String(120), primary_key=True),
    Column("site", String(120), nullable=False),
    Column("serial", String(200), nullable=False),
    Column("created_utc", String(40), nullable=False),
    Column("state", String(80), nullable=False),
    Column("software", String(40), nullable=False),
    Column("problem", Text, nullable=False),
    Column("seal", String(64), nullable=False),
    Index("run_by_machine", "serial", "created_utc"),
)
_FIGURE = (
    Column("gateway", String(200), primary_key=True),
    Column("run_id", String(120), primary_key=True),
    Column("subject", String(40), primary_key=True),
    Column("phase", String(20), primary_key=True),
    Column("parameter", String(20), primary_key=True),
    Column("value", Float, nullable=False),
    Column("expanded", Float, nullable=True),
    Column("unit", String(20), nullable=False),
    # The run's own, written with each figure: the newest figure of each machine is found without a join.
    Column("serial", String(200), nullable=False, server_default=""),
    Column("site", String(120), nullable=False, server_default=""),
    Column("created_utc", String(40), nullable=False, server_default=""),
    ForeignKeyConstraint(["gateway", "run_id"], ["run.gateway", "run.run_id"], ondelete="CASCADE"),
    Index("figure_by_machine", "parameter", "subject", "phase", "serial", "site", "created_utc"),
    Index("figure_by_time", "serial", "site", "subject", "created_utc"),
)
_TABLE = (
    Column("gateway", String(200), primary_key=True),
    Column("serial", String(200), primary_key=True),
    Column("name", String(80), primary_key=True),
    Column("axis", String(40), nullable=False),
    Column("table_id", String(12), nullable=False),
    Column("transaction", BigInteger, nullable=False),
    Column("utc", String(40), nullable=False),
    Column("enabled", Boolean, nullable=False),
    Column("kind", String(20), nullable=False),
    Column("problem", Text, nullable=False),
    Column("seal", String(64), nullable=False),
)
RUNS = Table("run", METADATA, *_RUN)
FIGURES = Table("figure", METADATA, *_FIGURE)
TABLES = Table("active_table", METADATA, *_TABLE)
