"""The IDS3010's JSON lines to messages and back, pure: requests out, results, errors and damage in.

Layout as public clients agree on it: {"jsonrpc", "method", "params", "id", "api": 2} asks; the answer's
"result" is a list whose first item is an error or warning number, 0 for none.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.message import Message

LONGEST = 1 << 16
API = 2


@dataclass(frozen=True, slots=True)
class Ask:
    """One request."""

    id: int
    method: str
    params: tuple[int | float | str, ...] = ()


@dataclass(frozen=True, slots=True)
class Result:
    """The items of a result, or the device's own error text in ``error``."""

    id: int
    items: tuple[object, ...]
    error: str = ""


@dataclass(frozen=True, slots=True)
class DamagedReply:
    """Bytes that are no answer, and why."""

    why: Message
    raw: bytes


Answer = Result | DamagedReply


class AttocubeCodec:
    """The client's end of one connection."""

    def __init__(self) -> None:
        self._rest = b""

    def send(self, ask: Ask) -> bytes:
        """A request as a line."""
        said = {"jsonrpc": "2.0", "method": ask.method, "params": list(ask.params), "id": ask.id, "api": API}
        return json.dumps(said, separators=(",", ":")).encode("ascii") + b"\r\n"

    def receive(self, data: bytes) -> Iterator[Answer]:
        """The answers these bytes complete; never raises."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = [_answer(line.strip()) for line in lines if line.strip()]
        if len(self._rest) > LONGEST:
            found.append(DamagedReply(Message.of("W-LINK-LONG-LINE", longest=LONGEST), self._rest[:80]))
            self._rest = b""
        return iter(found)


def _answer(line: bytes) -> Answer:
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return DamagedReply(Message.of("W-ATTO-NO-JSON"), line[:200])
    if not isinstance(said, dict) or type(said.get("id")) is not int:
        return DamagedReply(Message.of("W-ATTO-NO-ID"), line[:200])
    error, result = said.get("error"), said.get("result")
    if error is not None:
        text = error.get("message", error) if isinstance(error, dict) else error
        return Result(said["id"], (), str(text) or "error")
    if not isinstance(result, list) or not result:
        return DamagedReply(Message.of("W-ATTO-NO-RESULTS"), line[:200])
    return Result(said["id"], tuple(result))
