"""A control's recorded answers beside its double's: every difference is a line, a failing test and a row of a page.

Called by `doctor compare` and by the tests it writes. Asks through the site's driver alone; knows no simulator.
"""

from __future__ import annotations

from gateway.conform.asking import prober_of, recorded, replayed
from gateway.conform.writing import rows_text, suite_text, written

__all__ = ["prober_of", "recorded", "replayed", "rows_text", "suite_text", "written"]
