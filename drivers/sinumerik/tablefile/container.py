"""The NC archive of the control (the binary container of a series start-up): its members, and which of them are read.

Read off genuine archives: members follow each other at multiples of 512 bytes. A header of 512 holds the name at 0, the
name as shown at 50, the size as decimal text at 124, the time (UNIX) at 136, a check sum at 148 (the sum of all other
bytes of the header) and the folder at 384. The body is filled with NUL up to the next multiple of 512.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.grammar import VARIABLES
from drivers.sinumerik.tablefile.reader import TextSource
from drivers.tablefile import ArchiveMember

# An NC archive of the control (the binary container of a series start-up) -> its members.
#
# Read off genuine archives: members follow each other at multiples of 512 bytes; a header of 512 holds the name at 0,
# the name as shown at 50, the size as decimal text at 124, the time (UNIX) at 136, a check sum at 148 (the sum of all
# other bytes of the header) and the folder at 384; the body is filled with NUL up to the next multiple of 512.

BLOCK = 512
_NAME, _SHOWN = slice(0, 50), slice(50, 100)
_SIZE, _TIME, _SUM, _FOLDER = slice(124, 136), slice(136, 148), slice(148, 156), slice(384, BLOCK)
_DIGITS = re.compile(rb"\d{1,11}")
MOST_MEMBERS = 100_000


@dataclass(frozen=True, slots=True)
class ContainerMember:
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


def is_archive(data: bytes) -> bool:
    """Whether data begin with a header of such an archive."""
    return len(data) >= BLOCK and data[0] != 0 and b"\0" in data[:BLOCK] and _check_sum(data[:BLOCK]) is not None


def archive_members(data: bytes, where: str) -> tuple[ContainerMember, ...]:
    """Every member in its order. Raises FileFormatError (E-ARCHIVE-HEADER, E-ARCHIVE-CUT) with the place."""
    found: list[ContainerMember] = []
    at = 0
    while at < len(data) and data[at : at + BLOCK].strip(b"\0"):
        member, at = _read_member(data, at, where)
        found.append(member)
        if len(found) > MOST_MEMBERS:
            raise FileFormatError("E-ARCHIVE-HEADER", where, at=at)
    return tuple(found)


def _read_member(data: bytes, at: int, where: str) -> tuple[ContainerMember, int]:
    header = data[at : at + BLOCK]
    size = _header_number(header[_SIZE])
    if len(header) < BLOCK or size is None or _check_sum(header) is None:
        raise FileFormatError("E-ARCHIVE-HEADER", where, at=at)
    begin, name = at + BLOCK, _header_text(header[_NAME])
    if begin + size > len(data):
        raise FileFormatError("E-ARCHIVE-CUT", where, name=name, size=size, there=len(data) - begin)
    about = ArchiveMember(
        name,
        _header_text(header[_SHOWN]),
        folder=_header_text(header[_FOLDER]),
        size=size,
        changed=_header_number(header[_TIME]) or 0,
    )
    return ContainerMember(about, data[begin : begin + size]), begin + -(-size // BLOCK) * BLOCK


def _check_sum(header: bytes) -> int | None:
    """The check sum, where it stands in the header and is right."""
    said = _header_number(header[_SUM])
    return said if said is not None and said == sum(header) - sum(header[_SUM]) else None


def _header_number(field: bytes) -> int | None:
    digits = field.strip(b"\0 ")
    return int(digits) if _DIGITS.fullmatch(digits) else None


def _header_text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode("latin-1").strip()


# What of a file is read: a text itself, or those members of an NC archive that hold tables or describe the machine.
#
# Of an archive only the active NC data (folder \_NC_ACT.DIR\) are read: tables stand in AX_EEC.INI, AXn_EEC.INI and
# NC_CEC.INI, machine data in INITIAL.INI and in CFG_*.INI. Programs that assign compensation data are kept there for
# somebody to start; they say nothing of what acts.

_ACTIVE = "\\_NC_ACT.DIR\\"
_TABLES = re.compile(r"_N_(AX\d{0,2}_EEC|NC_CEC)_INI", re.ASCII)
_DATA = re.compile(r"_N_\w+_INI", re.ASCII)
_UNIT = re.compile(r"^\s*(METRIC|INCH)\s*$", re.MULTILINE)
_SETTINGS = "|".join(re.escape(name) for name in VARIABLES if not name.startswith(("$AA_", "$AN_")))
_LINE = re.compile(rf"^(?:N\d+\s+)?(?:{_SETTINGS})\[.*$", re.MULTILINE)


def read_texts(data: str | bytes, where: str) -> tuple[TextSource, ...]:
    """The texts to be read; none of an archive that holds no compensation data.

    Raises FileFormatError (E-ARCHIVE-HEADER, E-ARCHIVE-CUT).
    """
    if isinstance(data, str):
        return (TextSource(where, data),)
    if not is_archive(data):
        return (TextSource(where, data.decode("utf-8-sig", errors="replace")),)
    inside = [member for member in archive_members(data, where) if member.about.folder == _ACTIVE]
    tables = {member.about.name: member for member in inside if _TABLES.fullmatch(member.about.name)}
    others = {member.about.name: member for member in inside if _DATA.fullmatch(member.about.name)}
    described = [_machine_data_lines(member, where) for name, member in others.items() if name not in tables]
    return (
        *(TextSource(_member_place(member, where), member.text) for member in tables.values()),
        *(source for source in described if source is not None),
    )


def list_members(data: bytes, where: str) -> tuple[ArchiveMember, ...]:
    """The members of an archive; nothing of any other file. Raises as `read_texts`."""
    return tuple(member.about for member in archive_members(data, where)) if is_archive(data) else ()


def _member_place(member: ContainerMember, where: str) -> str:
    return f"{where}: {member.about.shown or member.about.name}"


def _machine_data_lines(member: ContainerMember, where: str) -> TextSource | None:
    """The lines of a large file of machine data that are ours, with the unit that it says; None if there are none."""
    text = member.text
    lines = [match.group() for match in _LINE.finditer(text)]
    unit = _UNIT.search(text)
    return (
        TextSource(_member_place(member, where), "\n".join([unit[1] if unit else "METRIC", *lines, "M17", ""]))
        if lines
        else None
    )
