"""Exit codes that no exception carries: verdicts. docs/exit-codes.md lists all of them."""

from __future__ import annotations

from collections.abc import Iterable

LIMIT_EXCEEDED = 13
REMEASURE, CANNOT_TELL = 20, 21


def of_verdicts(verdicts: Iterable[str]) -> int:
    """The code of some verdicts ("pass", "fail", "not decidable"): one that fails stands before one that is open."""
    said = set(verdicts)
    if "fail" in said:
        return LIMIT_EXCEEDED
    return CANNOT_TELL if "not decidable" in said else 0
