"""The rights of an OPC UA user: what each is for, which servers know it, who says so; `init`, doctor and pages follow.

Names are compared without regard to upper and lower case: the manuals of 12/2017 and 04/2018 print FSRead and FSWrite,
later ones FsRead and FsWrite.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Use = Literal["reading", "writing", "alarms"]
Version = tuple[int, int]

OLDEST: Version = (2, 0)
"""Oldest server that is supported: V2.0 SP1 (manual 04/2018), the first whose manual prints the file nodes (p. 58)."""
OLDEST_NAME = "V2.0 SP1 (04/2018)"


@dataclass(frozen=True, slots=True)
class Right:
    """One right. ``changes``: with it a user changes something. ``above``: only servers newer than this know it."""

    name: str
    use: Use
    purpose: str
    source: str
    changes: bool = False
    above: Version | None = None

    def known_to(self, version: Version | None) -> bool | None:
        """Whether a server of this version knows the right; None where it gave no version and not all know it."""
        if self.above is None:
            return True
        return None if version is None else version > self.above


ALL_READING = "SinuReadAll"
RIGHTS = (
    Right("StateRead", "reading", "channel, axes, alarm numbers, R parameters", "12/2017 p. 950"),
    Right("TeaRead", "reading", "machine data: axis names, reserved points, switches", "12/2017 p. 950"),
    Right("SeaRead", "reading", "setting data: switches of cross tables", "12/2017 p. 950"),
    Right("StateWrite", "writing", "R parameters, by which a program and the gateway talk", "12/2017 p. 950, p. 955; "
          "that this right and no other covers them: assumed", changes=True),
    Right("FsRead", "writing", "fetch files that a program wrote", "12/2017 p. 950 (printed FSRead)"),
    Right("FsWrite", "writing", "send programs", "12/2017 p. 950 (printed FSWrite)", changes=True),
    Right("ApWrite", "writing", "select a program", "digest of 05/2022; unknown to 12/2017 and 04/2018", changes=True,
          above=OLDEST),
    Right("AlarmRead", "alarms", "alarm texts as events; without it their numbers only", "12/2017 p. 950"),
)  # fmt: skip
SURPLUS = ("SinuWriteAll", "TeaWrite", "SeaWrite", "DriveWrite", "PlcWrite", "FrameWrite", "ToolWrite", "RandomWrite")
"""Rights that nothing here needs and with which a stranger could change the machine."""


def names(*uses: Use) -> tuple[str, ...]:
    """Names of the rights for these uses, in the table's order."""
    return tuple(right.name for right in RIGHTS if right.use in uses)


def held(answer: object) -> frozenset[str]:
    """Rights as one text or as a list of texts, spelled as this table does: the manuals show names only.

    Neither what stands between names nor upper case, "_" and "-" in them matter.
    """
    parts: Sequence[object] = answer if isinstance(answer, list | tuple) else [answer or ""]
    given = (name for part in parts for name in re.findall(r"[A-Za-z][\w-]*", str(part)))
    return frozenset(_SPELLED.get(re.sub(r"[_-]", "", name).casefold(), name) for name in given)


def missing(rights: Iterable[str], version: Version | None, *uses: Use) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Rights that are not held: those that this server knows, and those of which its version does not tell."""
    found = frozenset(rights)
    lacking = [
        right
        for right in RIGHTS
        if right.use in uses
        and right.name not in found
        and not (right.use == "reading" and ALL_READING in found)
        and right.known_to(version) is not False
    ]
    return (
        tuple(right.name for right in lacking if right.known_to(version)),
        tuple(right.name for right in lacking if not right.known_to(version)),
    )


def surplus(rights: Iterable[str], *, reads_alone: bool = False) -> tuple[str, ...]:
    """Rights beyond what is needed; a user that ``reads_alone`` needs none that changes anything."""
    beyond = (*(right.name for right in RIGHTS if right.changes), *SURPLUS) if reads_alone else SURPLUS
    found = frozenset(rights)
    return tuple(name for name in beyond if name in found)


def version_of(text: object) -> Version | None:
    """Major and minor number of a server's software version; None for a text without them."""
    match = re.search(r"(\d+)\.(\d+)", str(text or ""))
    return (int(match[1]), int(match[2])) if match else None


def as_page() -> str:
    """The table as the handbook has it."""
    rows = [
        f"| `{right.name}` | {right.use} | {right.purpose} | {_known(right)} | {right.source} |" for right in RIGHTS
    ]
    head = ["| right | for | needed for | servers that know it | source |", "|---|---|---|---|---|"]
    return "\n".join((*head, *rows))


def _known(right: Right) -> str:
    return "all that are supported" if right.above is None else f"newer than {OLDEST_NAME}"


_SPELLED = {name.casefold(): name for name in (*(right.name for right in RIGHTS), ALL_READING, *SURPLUS)}
