"""What is found quickly of all runs: an index in a database. Run folders are the truth; it can be made anew.

SQLite beside the runs, or one PostgreSQL for many gateways. Nothing a push decides is ever read from here. A library of
databases takes its time to load: the package loads it with the first question.
"""

from __future__ import annotations

from gateway.index.rows import IndexedFigure, IndexedRun, figures_of, gateway_name
from gateway.index.site_index import SiteIndex

__all__ = ["IndexedFigure", "IndexedRun", "SiteIndex", "figures_of", "gateway_name"]
