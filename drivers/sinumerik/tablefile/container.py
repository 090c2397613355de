"""An NC archive of the control (the binary container of a series start-up) -> its members.

Read off genuine archives: members follow each other at multiples of 512 bytes; a header of 512 holds the name at 0, the
name as shown at 50, the size as decimal text at 124, the time (UNIX) at 136, a check sum at 148 (the sum of all other
bytes of the header) and the folder at 384; the body is filled with NUL up to the next multiple of 512.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.errors import FileFormatError
from drivers.tablefile import ArchiveMember

BLOCK = 512
_NAME, _SHOWN = slice(0, 50), slice(50, 100)
_SIZE, _TIME, _SUM, _FOLDER = slice(124, 136), slice(136, 148), slice(148, 156), slice(384, BLOCK)
_DIGITS = re.compile(rb"\d{1,11}")
MOST_MEMBERS = 100_000


@dataclass(frozen=True, slots=True)
class Member:
    """One file of an archive: what its header says, and its content."""

    about: ArchiveMember
    body: bytes

    @property
    def text(self) -> str:
        """The content as text; what is no UTF-8 is read as the control's old code page."""
        try:
            return self.body.decode("utf-8")
        except UnicodeDecodeError:
            return self.body.decode("latin-1")


def is_container(data: bytes) -> bool:
    """Whether data begin with a header of such an archive."""
    return len(data) >= BLOCK and data[0] != 0 and b"\0" in data[:BLOCK] and _sum(data[:BLOCK]) is not None


def members(data: bytes, where: str) -> tuple[Member, ...]:
    """Every member in its order. Raises FileFormatError (E-ARCHIVE-HEADER, E-ARCHIVE-CUT) with the place."""
    found: list[Member] = []
    at = 0
    while at < len(data) and data[at : at + BLOCK].strip(b"\0"):
        member, at = _member(data, at, where)
        found.append(member)
        if len(found) > MOST_MEMBERS:
            raise FileFormatError("E-ARCHIVE-HEADER", where, at=at)
    return tuple(found)


def _member(data: bytes, at: int, where: str) -> tuple[Member, int]:
    header = data[at : at + BLOCK]
    size = _number(header[_SIZE])
    if len(header) < BLOCK or size is None or _sum(header) is None:
        raise FileFormatError("E-ARCHIVE-HEADER", where, at=at)
    begin, name = at + BLOCK, _text(header[_NAME])
    if begin + size > len(data):
        raise FileFormatError("E-ARCHIVE-CUT", where, name=name, size=size, there=len(data) - begin)
    about = ArchiveMember(
        name, _text(header[_SHOWN]), folder=_text(header[_FOLDER]), size=size, changed=_number(header[_TIME]) or 0
    )
    return Member(about, data[begin : begin + size]), begin + -(-size // BLOCK) * BLOCK


def _sum(header: bytes) -> int | None:
    """The check sum, where it stands in the header and is right."""
    said = _number(header[_SUM])
    return said if said is not None and said == sum(header) - sum(header[_SUM]) else None


def _number(field: bytes) -> int | None:
    digits = field.strip(b"\0 ")
    return int(digits) if _DIGITS.fullmatch(digits) else None


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode("latin-1").strip()
