"""Quirks of the server beyond what the manuals promise: switches that a test sets while it runs, and counters."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

from asyncua.ua.status_codes import code_to_name_doc

# By OPC 10000-4, 7.39: what an operation answers while its source is away, and what a service answers.
_SOURCE_DOWN = (
    "BadCommunicationError",
    "BadNoCommunication",
    "BadWaitingForInitialData",
    "BadNotConnected",
    "BadOutOfService",
    "BadDeviceFailure",
    "BadSensorFailure",
    "BadResourceUnavailable",
)
_BUSY = (
    "BadServerTooBusy",
    "BadTcpServerTooBusy",
    "BadInvalidState",
    "BadOutOfMemory",
    "BadTimeout",
    "BadInternalError",
)
_SESSION = ("BadSessionIdInvalid", "BadSessionClosed", "BadSecureChannelIdInvalid", "BadSessionNotActivated")
_PERMANENT = re.compile(
    r"Access|Allowed|Writable|Readable|Executable|Rights|Identity|Signature|Insufficient|Unknown$|"
    r"IdInvalid|IndexRange|NotSupported|NotImplemented|Unsupported|Deleted|NotInView|TypeDef|MethodInv"
)
STARTING_STATUSES = {
    "source": _SOURCE_DOWN,
    "busy": _BUSY,
    "session": _SESSION,
    "any": tuple(
        sorted(name for name, _ in code_to_name_doc.values() if name[:3] == "Bad" and not _PERMANENT.search(name))
    ),
}


@dataclass(slots=True)
class ServerQuirks:
    """Live switches. All off: the server is polite.

    ``answer_s``: seconds it takes to answer reads, writes and calls. ``late_write_s``: a write is carried out
    and answered only after so long, whether or not anybody still waits. ``read_status`` and ``write_status``:
    path -> status given in place of the value or the write ("GoodCompletesAsynchronously" writes and says so).
    ``stale_s``: values carry server time stamps this old. ``mute_events``: nothing is ever published.
    ``most_read`` and ``most_write``: nodes one request may name, 0 for no limit; ``tells_limits``: whether the
    server says so. ``silent_file_nodes``: with the access level too low a write through a file node is
    answered "good" and lost, as a real control was seen to do. ``quantise``: what a written number becomes.
    ``on_request``: called with the name of each service before it is served. ``starting``: what the server answers
    while the NCK restarts, drawn at each question by ``starting_seed``: a status of "source" (no value yet), "busy",
    "session" (the session is gone) or "any" of the standard but missing rights and absent nodes.
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
    starting: str = "source"
    starting_seed: int = 0
    started: list[str] = field(default_factory=list)
    _drawn: random.Random | None = None

    def draw_starting_status(self) -> str:
        """The next status of a server whose NCK restarts."""
        if self._drawn is None:
            self._drawn = random.Random(self.starting_seed)
        self.started.append(self._drawn.choice(STARTING_STATUSES[self.starting]))
        return self.started[-1]


@dataclass(slots=True)
class RequestCounters:
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
