"""One table through the port: the batch of one, and the two live sets that it brings."""

from __future__ import annotations

from drivers.types.orders import ReadBack
from drivers.types.tables import LiveSet


def sets_of(loaded: tuple[ReadBack, ...]) -> tuple[LiveSet, LiveSet]:
    """What stood before and what was read back, of the only table of a batch that the control found as sent."""
    (one,) = loaded
    assert one.agreed
    return one.backup, one.found
