"""Lines of several gateways, answered in turn, and refusals: a code of the gateway's catalogue with its fields."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple


class AgentRefusal(Exception):
    """Asked for something that cannot be had; ``code`` and ``fields`` go over the wire."""

    def __init__(self, code: str, **fields: object) -> None:
        super().__init__(code)
        self.code, self.fields = code, fields


MOST_LINES = 8
FIRST_S, SEND_S = 5.0, 5.0
MOST_FIRST, MOST_LINE = 4096, 8 << 20


class AgentReply(NamedTuple):
    """One line back, with its end; ``trusted``: whoever asked showed the token."""

    data: bytes
    trusted: bool


@dataclass(eq=False)
class _Line:
    """A connection: ``heard_s`` is when it came, later when it was last answered."""

    wire: socket.socket
    heard_s: float
    trusted: bool = False
    held: bytes = b""


class GatewayLines:
    """Every connection of one listener. ``answer`` makes an answer of a line."""

    def __init__(self, listener: socket.socket, answer: Callable[[bytes], AgentReply]) -> None:
        self._listener, self._answer = listener, answer
        self._ready = selectors.DefaultSelector()
        self._ready.register(listener, selectors.EVENT_READ)
        listener.setblocking(False)
        self._lines: list[_Line] = []

    def turn(self, wait_s: float) -> None:
        """Whatever came within this time: connections are taken, questions answered."""
        for key, _ in self._ready.select(wait_s):
            if key.data is None:
                self._take()
            elif key.data in self._lines and not self._served(key.data):
                self._drop(key.data)
        strange = [line for line in self._lines if not line.trusted and _now() - line.heard_s > FIRST_S]
        for line in strange:
            self._drop(line)

    def close(self) -> None:
        """End every connection; the listener stays."""
        for line in [*self._lines]:
            self._drop(line)
        self._ready.close()

    def _take(self) -> None:
        try:
            wire, _ = self._listener.accept()
        except OSError:  # it left again, or came to another child
            return
        if len(self._lines) >= MOST_LINES:  # first who never said who he is, then who was silent for longest
            self._drop(min(self._lines, key=lambda line: (line.trusted, line.heard_s)))
        wire.settimeout(SEND_S)
        self._lines.append(_Line(wire, _now()))
        self._ready.register(wire, selectors.EVENT_READ, self._lines[-1])

    def _drop(self, line: _Line) -> None:
        self._lines.remove(line)
        self._ready.unregister(line.wire)
        line.wire.close()

    def _served(self, line: _Line) -> bool:
        """AgentReply what is whole of what came; whether the line goes on."""
        try:
            data = line.wire.recv(1 << 16)
            *asked, line.held = (line.held + data).split(b"\n")
            for one in asked:
                answer = self._answer(one)
                line.wire.sendall(answer.data)
                line.trusted = line.trusted or answer.trusted
                line.heard_s = _now()
                if not line.trusted:
                    return False
        except OSError:
            return False
        return bool(data) and len(line.held) <= (MOST_LINE if line.trusted else MOST_FIRST)


def _now() -> float:
    return time.monotonic()
