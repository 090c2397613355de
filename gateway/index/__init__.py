"""What is found quickly of all runs: an index in a database. Run folders are the truth; it can be made anew.

SQLite beside the runs, or one PostgreSQL for many gateways. Nothing a push decides is ever read from here.
"""

from __future__ import annotations

from gateway.index.catching import caught_up, compared, due_of, index_of, known, rebuilt
from gateway.index.keeping import RunIndex, index_url
from gateway.index.rows import IndexedFigure, IndexedRun

__all__ = [
    "IndexedFigure",
    "IndexedRun",
    "RunIndex",
    "caught_up",
    "compared",
    "due_of",
    "index_of",
    "index_url",
    "known",
    "rebuilt",
]
