"""A site's index as it is asked: it follows the run folders first; its library is loaded with the first question."""

from __future__ import annotations

import threading
from datetime import datetime
from pathlib import Path
from typing import Any

from gateway.config import SiteFile
from gateway.store import Store

Rows = list[dict[str, Any]]


class SiteIndex:
    """The index of a site's runs; each answer says what the folders say now.

    A service is ready before the library of databases is loaded: only an address that the site file names is looked at
    when this is made. Raises ConfigError (E-INDEX-FILE, E-INDEX-EXTRA) then, and StoreError (E-INDEX) when asked.
    """

    def __init__(self, site: SiteFile, path: Path, store: Store) -> None:
        self._of = (site, path, store)
        self._turn = threading.Lock()
        self._index: Any = None
        if site.service.index_url_file is not None:
            self._made()

    def _made(self) -> Any:
        from gateway.index.database import index_of

        with self._turn:
            if self._index is None:
                self._index = index_of(*self._of)
        return self._index

    def _now(self) -> Any:
        self.caught_up()
        return self._index

    def caught_up(self) -> int:
        """Follow the folders; how many runs had changed since the last time."""
        from gateway.index.database import catch_up

        return catch_up(self._made(), self._of[2])

    def rebuilt(self) -> int:
        """Make everything anew; how many runs there are."""
        from gateway.index.database import rebuild

        return rebuild(self._made(), self._of[2])

    def search(self, text: str = "", *, serial: str = "", most: int = 100) -> Rows:
        """As `RunIndex.search`."""
        found: Rows = self._now().search(text, serial=serial, most=most)
        return found

    def trend(
        self, parameter: str, *, serial: str = "", subject: str = "", phase: str = "", before: str = "", most: int = 0
    ) -> Rows:
        """As `RunIndex.trend`. Raises ConfigError (E-INDEX-FIGURE) for a figure that no run holds."""
        from gateway.index.database import check_figure_known

        check_figure_known(parameter, subject)
        index = self._now()
        found: Rows = index.trend(parameter, serial=serial, subject=subject, phase=phase, before=before, most=most)
        return found

    def tables(self, *, serial: str = "") -> Rows:
        """As `RunIndex.tables`."""
        found: Rows = self._now().tables(serial=serial)
        return found

    def due(self, now: datetime) -> Rows:
        """As `due_measurements`, by the days that the site file names."""
        from gateway.index.database import due_measurements

        return due_measurements(self._now(), self._of[0].service.due_days, now)

    def compared(self, parameter: str, *, subject: str, phase: str = "after") -> Rows:
        """As `compared`. Raises ConfigError (E-INDEX-FIGURE)."""
        from gateway.index.database import compare_machines

        return compare_machines(self._now(), parameter, subject=subject, phase=phase)
