"""What of a file is read: a text itself, or those members of an NC archive that hold tables or describe the machine.

Of an archive only the active NC data (folder \\_NC_ACT.DIR\\) are read: tables stand in AX_EEC.INI, AXn_EEC.INI and
NC_CEC.INI, machine data in INITIAL.INI and in CFG_*.INI. Programs that assign compensation data are kept there for
somebody to start; they say nothing of what acts.
"""

from __future__ import annotations

import re

from drivers.sinumerik.tablefile.container import Member, is_container, members
from drivers.sinumerik.tablefile.reader import Source
from drivers.sinumerik.tablefile.variables import VARIABLES
from drivers.tablefile import ArchiveMember

_ACTIVE = "\\_NC_ACT.DIR\\"
_TABLES = re.compile(r"_N_(AX\d{0,2}_EEC|NC_CEC)_INI", re.ASCII)
_DATA = re.compile(r"_N_\w+_INI", re.ASCII)
_UNIT = re.compile(r"^\s*(METRIC|INCH)\s*$", re.MULTILINE)
_SETTINGS = "|".join(re.escape(name) for name in VARIABLES if not name.startswith(("$AA_", "$AN_")))
_LINE = re.compile(rf"^(?:N\d+\s+)?(?:{_SETTINGS})\[.*$", re.MULTILINE)


def opened(data: str | bytes, where: str) -> tuple[Source, ...]:
    """The texts to be read; none of an archive that holds no compensation data.

    Raises FileFormatError (E-ARCHIVE-HEADER, E-ARCHIVE-CUT).
    """
    if isinstance(data, str):
        return (Source(where, data),)
    if not is_container(data):
        return (Source(where, data.decode("utf-8-sig", errors="replace")),)
    inside = [member for member in members(data, where) if member.about.folder == _ACTIVE]
    tables = {member.about.name: member for member in inside if _TABLES.fullmatch(member.about.name)}
    others = {member.about.name: member for member in inside if _DATA.fullmatch(member.about.name)}
    described = [_described(member, where) for name, member in others.items() if name not in tables]
    return (
        *(Source(_place(member, where), member.text) for member in tables.values()),
        *(source for source in described if source is not None),
    )


def listed(data: bytes, where: str) -> tuple[ArchiveMember, ...]:
    """The members of an archive; nothing of any other file. Raises as `opened`."""
    return tuple(member.about for member in members(data, where)) if is_container(data) else ()


def _place(member: Member, where: str) -> str:
    return f"{where}: {member.about.shown or member.about.name}"


def _described(member: Member, where: str) -> Source | None:
    """The lines of a large file of machine data that are ours, with the unit that it says; None if there are none."""
    text = member.text
    lines = [match.group() for match in _LINE.finditer(text)]
    unit = _UNIT.search(text)
    return (
        Source(_place(member, where), "\n".join([unit[1] if unit else "METRIC", *lines, "M17", ""])) if lines else None
    )
