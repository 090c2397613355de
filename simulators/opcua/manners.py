"""How this server behaves besides what the manuals promise: switches a test turns while it runs, and counters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar


@dataclass(slots=True)
class Manners:
    """Live switches. All off: the server is polite.

    ``answer_s``: seconds it takes to answer reads, writes and calls. ``late_write_s``: a write is carried out
    and answered only after so long, whether or not anybody still waits. ``read_status`` and ``write_status``:
    path -> status given in place of the value or the write ("GoodCompletesAsynchronously" writes and says so).
    ``stale_s``: values carry server time stamps this old. ``mute_events``: nothing is ever published.
    ``most_read`` and ``most_write``: nodes one request may name, 0 for no limit; ``tells_limits``: whether the
    server says so. ``silent_file_nodes``: with the access level too low a write through a file node is
    answered "good" and lost, as a real control was seen to do. ``quantise``: what a written number becomes.
    ``on_request``: called with the name of each service before it is served.
    """

    answer_s: float = 0.0
    late_write_s: float = 0.0
    read_status: dict[str, str] = field(default_factory=dict)
    write_status: dict[str, str] = field(default_factory=dict)
    stale_s: float = 0.0
    mute_events: bool = False
    most_read: int = 0
    most_write: int = 0
    tells_limits: bool = True
    silent_file_nodes: bool = True
    quantise: Callable[[float], float] | None = None
    on_request: Callable[[str], None] = lambda _service: None


@dataclass(slots=True)
class Requests:
    """What clients asked for, counted: services by name, variables written, methods called."""

    services: Counter[str] = field(default_factory=Counter)
    written: Counter[str] = field(default_factory=Counter)
    called: Counter[str] = field(default_factory=Counter)

    READS: ClassVar[frozenset[str]] = frozenset(
        {"GetMyAccessRights", "CopyFileFromServer", "ConditionRefresh", "Open", "Read", "Close"}
    )

    @property
    def changing(self) -> int:
        """Write requests and method calls that could change anything."""
        calls = sum(count for name, count in self.called.items() if name not in self.READS)
        return self.services["write"] + calls
