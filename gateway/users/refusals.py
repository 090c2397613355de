"""Refused sign-ins, summed: a stranger's tries must not fill the audit log nor keep the service from its work."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime

MOST_KEPT = 256
REST = "(others)"


@dataclass(frozen=True, slots=True)
class RefusedSignIn:
    """Refused tries with one name from one address: how many, the first and the last (UTC)."""

    name: str
    address: str
    count: int
    first: datetime
    last: datetime

    def as_data(self) -> dict[str, object]:
        """As the audit log keeps it."""
        first, last = (one.isoformat(timespec="seconds") for one in (self.first, self.last))
        return {"name": self.name, "address": self.address, "count": self.count, "first": first, "last": last}


class RefusedSignIns:
    """What was refused since it was last taken. Beyond `MOST_KEPT` pairs only the sum is kept, as `REST`."""

    def __init__(self) -> None:
        self.total = 0
        self._kept: dict[tuple[str, str], RefusedSignIn] = {}

    def add(self, name: str, address: str, utc: datetime) -> None:
        """One more."""
        self.total += 1
        key = (name, address)
        if key not in self._kept and len(self._kept) >= MOST_KEPT:
            key = (REST, REST)
        known = self._kept.get(key) or RefusedSignIn(*key, count=0, first=utc, last=utc)
        self._kept[key] = replace(known, count=known.count + 1, last=utc)

    def take(self) -> tuple[RefusedSignIn, ...]:
        """All since the last time, the most tried first; they are forgotten here."""
        found, self._kept = tuple(self._kept.values()), {}
        return tuple(sorted(found, key=lambda one: (-one.count, one.name, one.address)))
