"""Binary sample frames of the instrument bridge, version 1: bytes to frames and back, every byte checked, pure.

Layout (little-endian, docs/instrument-bridge.md section 5): a header of 48 bytes with a check sum of its own, then
count x channels doubles, sample after sample. A frame begins with a byte that no UTF-8 text holds.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from math import isfinite
from zlib import crc32

import numpy as np

from drivers.errors import LocalProtocolError
from drivers.types.values import FloatArray

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


def encode(frame: SampleFrame) -> bytes:
    """A frame as bytes. Raises LocalProtocolError (E-BRIDGE-MESSAGE) for what no frame may hold."""
    values = np.ascontiguousarray(frame.values, "<f8")
    if values.ndim != 2 or not 0 < values.nbytes <= PAYLOAD_BYTES:
        raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why=f"samples of shape {values.shape} in a frame")
    if not (isfinite(frame.t0_s) and isfinite(frame.dt_s) and frame.dt_s > 0 and np.isfinite(values).all()):
        raise LocalProtocolError("E-BRIDGE-MESSAGE", "bridge", why="a frame holds finite numbers only")
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
