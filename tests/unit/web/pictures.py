"""Pictures of an invented daemon."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import TransportError, TrueflankError
from drivers.message import Message
from gateway.views import PastRun, ResultRow, RunView, StatusView, device_views


@dataclass(frozen=True)
class Seen:
    """One device as a supervisor tells it."""

    name: str
    driver: str
    state: str
    since_utc: str = "2026-03-02T08:00:00+00:00"
    error: TrueflankError | None = None


STOP = Message.of("P-STOP", axis="C1", program="bidirectional", done=12, total=240)


def status(**changes: object) -> StatusView:
    """A site with one device lost, a run at work, two runs behind it."""
    lost = TransportError("E-LINK-DEADLINE", "laser", timeout_s=5)
    view: dict[str, object] = {
        "site": "hall-3-grinder",
        "software": "trueflank 0.1.0",
        "now_utc": "2026-03-02T09:30:00+00:00",
        "devices": device_views(
            [Seen("controller", "sinumerik-opcua", "open"), Seen("laser", "umd", "lost", error=lost)], lent=False
        ),
        "run": RunView(
            "r-3", "bidirectional", "C1", 12, 240, Message.stored("C1: stop 12 of 240"), "2026-03-02T09:00:00+00:00"
        ),
        "last_runs": (
            PastRun("r-2", "2026-03-01T09:00:00+00:00", "better", "", report=True),
            PastRun("r-1", "2026-02-01T09:00:00+00:00", "failed", "no disk", report=False),
        ),
        "result": (ResultRow("C1", "M", "36.41", "1.26", "arcsec", "−97 %"),),
    }
    return StatusView(**{**view, **changes})  # type: ignore[arg-type]
