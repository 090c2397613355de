"""Binary sample frames of the instrument bridge, version 1: bytes to frames and back, every byte checked, pure.

Layout (little-endian, docs/instrument-bridge.md section 5): a header of 48 bytes with a check sum of its own, then
count x channels doubles, sample after sample. A frame begins with a byte that no UTF-8 text holds.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Literal
from zlib import crc32

import numpy as np

from drivers.errors import LocalProtocolError
from drivers.message import Message
from drivers.types.values import FloatArray

# Binary sample frames of the instrument bridge, version 1: bytes to frames and back, every byte checked, pure.
#
# Layout (little-endian, docs/instrument-bridge.md section 5): a header of 48 bytes with a check sum of its own, then
# count x channels doubles, sample after sample. A frame begins with a byte that no UTF-8 text holds.

MAGIC = b"\xfaTFS"
VERSION = 1
INVALID = 0x01
PAYLOAD_BYTES = 1 << 20
VALUE_BYTES = 8
# Frames are one stretch where the later begins this near, in spacings, to where the earlier ends.
JOIN = 1e-3
_HEADER = struct.Struct("<4sBBHQIIddI")
_CHECK = struct.Struct("<I")
# Magic, version, flags and channels are the same in all frames of a stretch; the rest of a header after them.
_ALIKE = 8
_REST = struct.Struct("<QIIddII")
HEADER_BYTES = _HEADER.size + _CHECK.size


@dataclass(frozen=True, slots=True)
class Header:
    """What stands before the samples; ``size`` bytes of them follow, whose CRC-32 is ``payload_crc``."""

    flags: int
    channels: int
    sequence: int
    count: int
    lost: int
    t0_s: float
    dt_s: float
    payload_crc: int

    @property
    def size(self) -> int:
        """Bytes of the payload."""
        return self.count * self.channels * VALUE_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class SampleFrame:
    """Evenly spaced samples; ``values`` shape (n, channels) in the order the bridge named its channels.

    ``sequence`` number of the first sample since the stream started, ``t0_s`` its instrument time, ``dt_s`` the
    spacing. ``lost`` samples were skipped just before. Not ``valid``: none of them is.
    """

    sequence: int
    t0_s: float
    dt_s: float
    values: FloatArray
    lost: int = 0
    valid: bool = field(default=True)

    def __len__(self) -> int:
        return len(self.values)


def encode_frame(frame: SampleFrame) -> bytes:
    """A frame as bytes. Raises LocalProtocolError (E-BRIDGE-MESSAGE) for what no frame may hold."""
    values = np.ascontiguousarray(frame.values, "<f8")
    if values.ndim != 2 or not 0 < values.nbytes <= PAYLOAD_BYTES:
        raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=Message.of("W-BRIDGE-SHAPE", shape=values.shape))
    if not (isfinite(frame.t0_s) and isfinite(frame.dt_s) and frame.dt_s > 0 and np.isfinite(values).all()):
        raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=Message.of("W-BRIDGE-FINITE"))
    payload = values.tobytes()
    count, channels = values.shape
    flags = 0 if frame.valid else INVALID
    try:
        head = _HEADER.pack(
            MAGIC, VERSION, flags, channels, frame.sequence, count, frame.lost, frame.t0_s, frame.dt_s, crc32(payload)
        )
    except struct.error as error:
        raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=str(error)) from error
    return head + _CHECK.pack(crc32(head)) + payload


def read_header(data: bytes, at: int) -> Header | None:
    """The header that begins at ``at``, of which all bytes are there; None unless each of them is right."""
    (check,) = _CHECK.unpack_from(data, at + _HEADER.size)
    if crc32(data[at : at + _HEADER.size]) != check:
        return None
    magic, version, *fields = _HEADER.unpack_from(data, at)
    header = Header(*fields)
    plausible = header.flags & ~INVALID == 0 and 0 < header.size <= PAYLOAD_BYTES and 0 < header.dt_s < np.inf
    return header if magic == MAGIC and version == VERSION and plausible and isfinite(header.t0_s) else None


def read_run(data: bytes, at: int, first: Header) -> tuple[SampleFrame, int] | None:
    """The frame whose header begins at ``at``, joined with those that follow it without a gap; and where they end.

    None where the samples are not those the header was written for. Only frames that are whole, right, of one
    size and one another's neighbours in number and time are joined: the samples are the same as one by one.
    """
    whole = HEADER_BYTES + first.size
    view = memoryview(data)
    if crc32(view[at + HEADER_BYTES : at + whole]) != first.payload_crc:
        return None
    end = at + whole
    number, joined = first.sequence, 1
    alike = data[at : at + _ALIKE]
    while len(data) - end >= whole and data[end : end + _ALIKE] == alike:
        number += first.count
        sequence, count, lost, t0_s, dt_s, payload_crc, check = _REST.unpack_from(data, end + _ALIKE)
        late_s = t0_s - first.t0_s - (number - first.sequence) * first.dt_s
        neighbours = (sequence, count, lost, dt_s) == (number, first.count, 0, first.dt_s)
        if not neighbours or abs(late_s) > JOIN * dt_s or crc32(data[end : end + _HEADER.size]) != check:
            break
        if crc32(view[end + HEADER_BYTES : end + whole]) != payload_crc:
            break
        end, joined = end + whole, joined + 1
    return _frame(data, at, first, joined, end)


def _frame(data: bytes, at: int, first: Header, joined: int, end: int) -> tuple[SampleFrame, int] | None:
    rows = np.frombuffer(data, np.uint8, end - at, at).reshape(joined, -1)[:, HEADER_BYTES:]
    values = np.ascontiguousarray(rows).reshape(-1).view("<f8").reshape(-1, first.channels)
    # A sum is finite only if all are, or overflows: the slow question is asked in that case alone.
    if not isfinite(float(values.sum())) and not np.isfinite(values).all():
        if joined == 1:
            return None
        return _frame(data, at, first, 1, at + HEADER_BYTES + first.size)
    valid = not first.flags & INVALID
    return SampleFrame(
        sequence=first.sequence, t0_s=first.t0_s, dt_s=first.dt_s, values=values, lost=first.lost, valid=valid
    ), end


# Bridge lines and frames: JSON-RPC 2.0 objects and binary samples to messages and back, pure, in either role.
#
# Source: JSON-RPC 2.0 specification (2013-01-04) sections 4 and 5, narrowed by docs/instrument-bridge.md: parameters
# by name only, integer ids, no batches, no NaN or Infinity, lines of at most 1 MiB. Frames stand between the lines;
# after damage the reader goes on at the next frame or line that is whole and right.

Role = Literal["client", "server"]
LINE_BYTES = 1 << 20
SHOWN_BYTES = 200
_BLANK = b"\n\r\t "
_SPACES = re.compile(rb"[\n\r\t ]*")
# Bytes that no line of JSON in UTF-8 holds: whatever they belong to is binary, or damage.
_NO_TEXT = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\xc0\xc1\xf5-\xff]")
_MAY_OVERFLOW = re.compile(rb"[0-9][eE]|[0-9]{300}")
_BEGINNINGS = re.compile(rb"\xfa(?:TFS|TF\Z|T\Z|\Z)|\{\s*(?:\"|\Z)")


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
class BridgeRefusal:
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
    """Bytes that are none of these (the first of them), and why.

    ``skipped`` 0: one line of text; else so many bytes were passed over to the next frame or line.
    """

    raw: bytes
    why: str | Message
    skipped: int = 0


BridgeMessage = Request | Reply | BridgeRefusal | Notification | Damaged | SampleFrame
_MAY_SEND: dict[Role, tuple[type, ...]] = {
    "client": (Request,),
    "server": (Reply, BridgeRefusal, Notification, SampleFrame),
}


class BridgeCodec:
    """One end of a bridge line. The client asks; the server answers, notifies and sends frames.

    With ``echo`` a client's own questions may come back on its line and are passed over.
    """

    def __init__(self, role: Role, *, echo: bool = False) -> None:
        self._role = role
        self._echo = echo
        self._peer: Role = "server" if role == "client" else "client"
        self._parts: list[bytes] = []
        self._held = 0
        self._needed = 1
        self._overlong = False

    def send(self, message: BridgeMessage) -> bytes:
        """A message as one line or frame. Raises LocalProtocolError: E-BRIDGE-ROLE, E-BRIDGE-MESSAGE."""
        if not isinstance(message, _MAY_SEND[self._role]):
            kind = type(message).__name__
            raise LocalProtocolError("E-BRIDGE-ROLE", "bridge", role=self._role, kind=kind)
        if isinstance(message, SampleFrame):
            return encode_frame(message)
        try:
            text = json.dumps(_as_object(message), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
            line = text.encode("utf-8") + b"\n"
        except (TypeError, ValueError, RecursionError) as error:
            raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=str(error)) from error
        if len(line) > LINE_BYTES:
            why = Message.of("W-BRIDGE-LONG-OUT", count=len(line), line_bytes=LINE_BYTES)
            raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=why)
        return line

    def receive(self, data: bytes) -> tuple[BridgeMessage, ...]:
        """Any bytes to the messages they complete; what is no message comes as `Damaged`. Never raises."""
        self._parts.append(data)
        self._held += len(data)
        if self._held < self._needed:
            return ()
        whole = data if len(self._parts) == 1 else b"".join(self._parts)
        found: list[BridgeMessage] = []
        at = self._read_all(whole, found)
        rest = whole[at:] if at else whole
        self._parts, self._held = ([rest] if rest else []), len(rest)
        return tuple(found)

    def _read_all(self, data: bytes, found: list[BridgeMessage]) -> int:
        """Append every message that is whole; where the first that is not begins."""
        at = self._end_of_overlong(data, found) if self._overlong else 0
        while True:
            blank = _SPACES.match(data, at)
            at = blank.end() if blank else at
            self._needed = 1
            after = self._read_one(data, at, found) if at < len(data) else at
            if after == at:
                return at
            at = after

    def _read_one(self, data: bytes, at: int, found: list[BridgeMessage]) -> int:
        if self._role == "client" and data[at] == MAGIC[0]:
            return self._read_frame(data, at, found)
        end = data.find(b"\n", at)
        if end < 0:
            return self._wait_for_line(data, at, found)
        line = data[at:end].strip(_BLANK)
        message = self._read_line(line)
        if isinstance(message, Damaged) and _NO_TEXT.search(line):
            return self._resync(data, at, message.why, found)
        if message is not None:
            found.append(message)
        return end + 1

    def _read_frame(self, data: bytes, at: int, found: list[BridgeMessage]) -> int:
        if not MAGIC.startswith(data[at : at + len(MAGIC)]):
            return self._resync(data, at, "neither a line nor a frame", found)
        if len(data) - at < HEADER_BYTES:
            return self._wait(at, HEADER_BYTES)
        header = read_header(data, at)
        if header is None:
            return self._resync(data, at, Message.of("W-BRIDGE-HEADER"), found)
        end = at + HEADER_BYTES + header.size
        if len(data) < end:
            return self._wait(at, end - at)
        read = read_run(data, at, header)
        if read is None:
            return self._resync(data, at, Message.of("W-BRIDGE-SAMPLES"), found)
        found.append(read[0])
        return read[1]

    def _wait(self, at: int, needed: int) -> int:
        """Nothing to read before so many bytes are there from ``at`` on."""
        self._needed = needed
        return at

    def _wait_for_line(self, data: bytes, at: int, found: list[BridgeMessage]) -> int:
        if _NO_TEXT.search(data, at):
            return self._resync(data, at, "neither a line nor a frame", found)
        if len(data) - at < LINE_BYTES:
            return at
        self._overlong = True
        return len(data)

    def _end_of_overlong(self, data: bytes, found: list[BridgeMessage]) -> int:
        end = data.find(b"\n") + 1
        if not end:
            return len(data)
        self._overlong = False
        found.append(Damaged(b"", Message.of("W-BRIDGE-LONG-IN", line_bytes=LINE_BYTES)))
        return end

    def _resync(self, data: bytes, at: int, why: str | Message, found: list[BridgeMessage]) -> int:
        """Pass over damage to the next beginning of something right, or that may yet turn out right."""
        to = at + 1
        while True:
            begin = _BEGINNINGS.search(data, to)
            if begin is None:
                to = len(data)
                break
            to = begin.start()
            if self._may_begin(data, to):
                break
            to += 1
        found.append(Damaged(data[at : min(to, at + SHOWN_BYTES)], why, to - at))
        return to

    def _may_begin(self, data: bytes, at: int) -> bool:
        if data[at] == MAGIC[0]:
            return len(data) - at < HEADER_BYTES or read_header(data, at) is not None
        end = data.find(b"\n", at)
        if end < 0:
            return len(data) - at < LINE_BYTES and not _NO_TEXT.search(data, at)
        return not isinstance(self._read_line(data[at:end].strip(_BLANK)), Damaged)

    def _read_line(self, line: bytes) -> BridgeMessage | None:
        if len(line) >= LINE_BYTES:
            return Damaged(b"", Message.of("W-BRIDGE-LONG-IN", line_bytes=LINE_BYTES))
        message = parse_line(line)
        if isinstance(message, (Damaged, *_MAY_SEND[self._peer])):
            return message
        if self._echo and isinstance(message, Request):
            return None
        return Damaged(
            line[:SHOWN_BYTES], Message.of("W-BRIDGE-NOT-YOURS", name=type(message).__name__, peer=self._peer)
        )


def _as_object(message: BridgeMessage) -> dict[str, Any]:
    head: dict[str, Any] = {"jsonrpc": "2.0"}
    match message:
        case Request(number, method, params):
            return head | {"id": number, "method": method, "params": dict(params)}
        case Notification(method, params):
            return head | {"method": method, "params": dict(params)}
        case Reply(number, result):
            return head | {"id": number, "result": result}
        case BridgeRefusal(asked, code, text, data):
            extra = {} if data is None else {"data": data}
            return head | {"id": asked, "error": {"code": code, "message": text} | extra}
        case Damaged() | SampleFrame():
            raise TypeError("this is no line")


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is no JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"{text[:20]} is beyond all bounds")
    return value


def parse_line(line: bytes) -> BridgeMessage:
    """One line, without its end, to a message; `Damaged` says why it is none."""
    try:
        whole = _finite if _MAY_OVERFLOW.search(line) else None
        found = json.loads(line.decode("utf-8"), parse_constant=_refuse_constant, parse_float=whole)
        return _message(found)
    except (ValueError, RecursionError) as error:
        return Damaged(line[:SHOWN_BYTES], str(error) or type(error).__name__)


def _message(found: Any) -> BridgeMessage:
    if not isinstance(found, dict) or found.get("jsonrpc") != "2.0":
        raise ValueError("no JSON-RPC 2.0 object")
    if "method" in found:
        return _call(found)
    if ("result" in found) == ("error" in found):
        raise ValueError("neither a call nor an answer")
    if "result" in found:
        return Reply(_id(found.get("id")), found["result"])
    return _refusal(found)


def _call(found: dict[str, Any]) -> BridgeMessage:
    method, params = found["method"], found.get("params", {})
    if not isinstance(method, str) or not isinstance(params, dict):
        raise ValueError("method must be text and params an object")
    if "id" in found:
        return Request(_id(found["id"]), method, params)
    return Notification(method, params)


def _refusal(found: dict[str, Any]) -> BridgeRefusal:
    error = found["error"]
    if not isinstance(error, dict) or not isinstance(error.get("message"), str):
        raise ValueError("error must hold a code and a message")
    asked = None if found.get("id") is None else _id(found["id"])
    return BridgeRefusal(asked, _id(error.get("code")), error["message"], error.get("data"))


def _id(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError("ids and codes must be integers")
    return value
