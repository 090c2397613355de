"""The agent's JSON lines to messages and back, pure: questions with a token out, results and refusals in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.message import Message

LONGEST = 8 << 20


@dataclass(frozen=True, slots=True)
class AgentAsk:
    """One question: its number, what is to be done, and with what."""

    id: int
    do: str
    told: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AgentAnswer:
    """The answer of that number: its value, or the code and fields of a refusal; ``id`` None where nothing was read."""

    id: int | None
    value: Any = None
    code: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)


class AgentCodec:
    """The gateway's end of one connection. ``token`` goes with every question."""

    def __init__(self, token: str) -> None:
        self._token = token
        self._rest = b""

    def send(self, ask: AgentAsk) -> bytes:
        """A question as a line."""
        told = {**ask.told, "id": ask.id, "do": ask.do, "token": self._token}
        return json.dumps(told, separators=(",", ":")).encode() + b"\n"

    def receive(self, data: bytes) -> Iterator[AgentAnswer]:
        """The answers these bytes complete; never raises."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = [_answer(line) for line in lines if line.strip()]
        if len(self._rest) > LONGEST:
            self._rest = b""
            found.append(_damaged(Message.of("W-LINK-LONG-LINE", longest=LONGEST)))
        return iter(found)


def _damaged(why: str | Message) -> AgentAnswer:
    return AgentAnswer(None, code="E-LCNC-ANSWER", fields={"why": why})


def _answer(line: bytes) -> AgentAnswer:
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return _damaged("no JSON")
    if not isinstance(said, dict) or ("ok" in said) == ("code" in said):
        return _damaged("neither a result nor a refusal")
    number = said.get("id")
    if "ok" in said:
        return AgentAnswer(number, said["ok"]) if type(number) is int else _damaged("no number")
    code, fields = said["code"], said.get("fields")
    if not isinstance(code, str) or not isinstance(fields, dict):
        return _damaged(Message.of("W-LCNC-NO-CODE"))
    return AgentAnswer(number if type(number) is int else None, code=code, fields=fields)
