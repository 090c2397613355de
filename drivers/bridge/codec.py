"""Bridge lines: JSON-RPC 2.0, one object a line in UTF-8, to messages and back, pure, in either role.

Source: JSON-RPC 2.0 specification (2013-01-04) sections 4 and 5, narrowed by docs/instrument-bridge.md:
parameters by name only, integer ids, no batches, no NaN or Infinity, lines of at most 1 MiB.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from drivers.errors import LocalProtocolError

Role = Literal["client", "server"]
LINE_BYTES = 1 << 20
SHOWN_BYTES = 200


@dataclass(frozen=True, slots=True)
class Request:
    """A call that wants an answer."""

    id: int
    method: str
    params: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to the request of the same id."""

    id: int
    result: Any


@dataclass(frozen=True, slots=True)
class Refusal:
    """A no to the request of the same id; id None where the bridge could not even read one."""

    id: int | None
    code: int
    message: str
    data: Any = None


@dataclass(frozen=True, slots=True)
class Notification:
    """Something said unasked."""

    method: str
    params: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Damaged:
    """A line that is none of these, as received (its first bytes), and why."""

    raw: bytes
    why: str


Message = Request | Reply | Refusal | Notification | Damaged
_MAY_SEND: dict[Role, tuple[type, ...]] = {
    "client": (Request,),
    "server": (Reply, Refusal, Notification),
}


class BridgeCodec:
    """One end of a bridge line. The client asks; the server answers and notifies."""

    def __init__(self, role: Role) -> None:
        self._role = role
        self._peer: Role = "server" if role == "client" else "client"
        self._pending = bytearray()
        self._overlong = False

    def send(self, message: Message) -> bytes:
        """A message as one line. Raises LocalProtocolError: E-BRIDGE-ROLE, E-BRIDGE-MESSAGE."""
        if not isinstance(message, _MAY_SEND[self._role]):
            kind = type(message).__name__
            raise LocalProtocolError("E-BRIDGE-ROLE", "bridge", role=self._role, kind=kind)
        try:
            text = json.dumps(_as_object(message), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
            line = text.encode("utf-8") + b"\n"
        except (TypeError, ValueError, RecursionError) as error:
            raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=str(error)) from error
        if len(line) > LINE_BYTES:
            why = f"a line of {len(line)} bytes is longer than {LINE_BYTES}"
            raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=why)
        return line

    def receive(self, data: bytes) -> tuple[Message, ...]:
        """Any bytes to the messages they complete; what is no message comes as `Damaged`. Never raises."""
        self._pending += data
        *lines, rest = self._pending.split(b"\n")
        self._pending = rest
        found = [self._read(bytes(line)) for line in lines]
        if len(rest) >= LINE_BYTES:
            self._overlong = True
            rest.clear()
        return tuple(message for message in found if message is not None)

    def _read(self, line: bytes) -> Message | None:
        line = line.strip(b" \t\r")
        if self._overlong or len(line) >= LINE_BYTES:
            self._overlong = False
            return Damaged(b"", f"a line longer than {LINE_BYTES} bytes")
        if not line:
            return None
        message = parse(line)
        if isinstance(message, (Damaged, *_MAY_SEND[self._peer])):
            return message
        return Damaged(line[:SHOWN_BYTES], f"a {type(message).__name__} is not for a {self._peer} to send")


def _as_object(message: Message) -> dict[str, Any]:
    head: dict[str, Any] = {"jsonrpc": "2.0"}
    match message:
        case Request(number, method, params):
            return head | {"id": number, "method": method, "params": dict(params)}
        case Notification(method, params):
            return head | {"method": method, "params": dict(params)}
        case Reply(number, result):
            return head | {"id": number, "result": result}
        case Refusal(asked, code, text, data):
            extra = {} if data is None else {"data": data}
            return head | {"id": asked, "error": {"code": code, "message": text} | extra}
        case Damaged():
            raise TypeError("a damaged line cannot be sent")


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no JSON number")


def parse(line: bytes) -> Message:
    """One line, without its end, to a message; `Damaged` says why it is none."""
    try:
        found = json.loads(line.decode("utf-8"), parse_constant=_refuse_constant)
        return _message(found)
    except (ValueError, RecursionError) as error:
        return Damaged(line[:SHOWN_BYTES], str(error) or type(error).__name__)


def _message(found: Any) -> Message:
    if not isinstance(found, dict) or found.get("jsonrpc") != "2.0":
        raise ValueError("no JSON-RPC 2.0 object")
    if "method" in found:
        return _call(found)
    if ("result" in found) == ("error" in found):
        raise ValueError("neither a call nor an answer")
    if "result" in found:
        return Reply(_id(found.get("id")), found["result"])
    return _refusal(found)


def _call(found: dict[str, Any]) -> Message:
    method, params = found["method"], found.get("params", {})
    if not isinstance(method, str) or not isinstance(params, dict):
        raise ValueError("method must be text and params an object")
    if "id" in found:
        return Request(_id(found["id"]), method, params)
    return Notification(method, params)


def _refusal(found: dict[str, Any]) -> Refusal:
    error = found["error"]
    if not isinstance(error, dict) or not isinstance(error.get("message"), str):
        raise ValueError("error must hold a code and a message")
    asked = None if found.get("id") is None else _id(found["id"])
    return Refusal(asked, _id(error.get("code")), error["message"], error.get("data"))


def _id(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError("ids and codes must be integers")
    return value
