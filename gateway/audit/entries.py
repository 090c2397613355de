"""One record of the log as one line of canonical JSON that carries its own hash and that of the record before; pure.

The hash is the SHA-256 of the line's bytes without the member ``hash`` and the line end: keys sorted, no spaces, ASCII.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from gateway.errors import CorruptRecord

Role = Literal["operator", "approver", "service", "program"]
START = "0" * 64
TORN = "torn-line"
CORRECTION = "correction"
_HEAD = re.compile(r"(\d{1,12}):([0-9a-f]{64})")
# Members are sorted by name, so what stands behind ``hash`` is fixed; no text before it can look like it, because
# a quote inside a text is escaped.
_LINE = re.compile(
    rb'(\{"action":".*),"hash":"([0-9a-f]{64})"'
    rb'(,"monotonic_s":.*,"prev_hash":"([0-9a-f]{64})","process":\d+,"role":"[a-z]+","seq":(\d+),"serial":".*\})'
)


@dataclass(frozen=True, slots=True)
class ChainHead:
    """The end of a chain: number and hash of its last record; ``seq`` 0 is a log without records."""

    seq: int = 0
    hash: str = START

    def __str__(self) -> str:
        return f"{self.seq}:{self.hash}"


@dataclass(frozen=True, slots=True)
class Happening:
    """What was done: by whom, as what, to which machine, in which transaction; hashes of plan, old and new table.

    ``details`` values are texts, numbers or truth values.
    """

    action: str
    actor: str
    role: Role = "operator"
    serial: str = ""
    transaction: int = 0
    plan_hash: str = ""
    base_hash: str = ""
    new_hash: str = ""
    details: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """A record as kept. ``monotonic_s`` counts in the process named by ``process``: it does not jump with the date.

    ``clock`` is what the computer knew of its own clock then (`gateway.audit.timekeeping`); empty in older records.
    """

    seq: int
    utc: str
    monotonic_s: float
    process: int
    software: str
    happening: Happening
    prev_hash: str
    hash: str = ""
    clock: Mapping[str, object] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        """The record as JSON data, as it stands in its line."""
        data: dict[str, Any] = {**asdict(self), **asdict(self.happening)}
        del data["happening"]
        if not self.clock:
            del data["clock"]
        data["details"] = {str(key): _plain(value) for key, value in self.happening.details.items()}
        return data


def _plain(value: object) -> object:
    if isinstance(value, (str, bool, int)) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return str(value)


def line_of(entry: AuditEntry) -> tuple[bytes, ChainHead]:
    """The record's line with its line end, and the head of the chain it makes; ``entry.hash`` is ignored."""
    data = entry.as_data()
    del data["hash"]
    digest = hashlib.sha256(_canonical(data)).hexdigest()
    return _canonical({**data, "hash": digest}) + b"\n", ChainHead(entry.seq, digest)


def _canonical(data: object) -> bytes:
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.encode("ascii")


def follows(line: bytes, before: ChainHead) -> ChainHead | None:
    """The head after this line (without its end), or None when it is damaged or does not follow ``before``."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    digest = found[2].decode("ascii")
    if hashlib.sha256(found[1] + found[3]).hexdigest() != digest:
        return None
    same_chain = int(found[5]) == before.seq + 1 and found[4].decode("ascii") == before.hash
    return ChainHead(before.seq + 1, digest) if same_chain else None


def head_of_line(line: bytes) -> ChainHead | None:
    """The head that a sound line (without its end) states, whatever stands before it; None when it is damaged."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    return follows(line, ChainHead(int(found[5]) - 1, found[4].decode("ascii")))


def head_of(text: str) -> ChainHead:
    """A head as exported, ``number:hash`` or the hash alone (number 0). Raises CorruptRecord (E-AUDIT-HEAD)."""
    found = _HEAD.fullmatch(text.strip())
    if found is not None:
        return ChainHead(int(found[1]), found[2])
    if re.fullmatch(r"[0-9a-f]{64}", text.strip()):
        return ChainHead(0, text.strip())
    raise CorruptRecord("E-AUDIT-HEAD", "head", found=text.strip()[:80] or "nothing")


def torn_facts(fragment: bytes) -> dict[str, object]:
    """What the record about a torn end says of it."""
    return {"bytes": len(fragment), "sha256": hashlib.sha256(fragment).hexdigest()}


def speaks_of(line: bytes, fragment: bytes) -> bool:
    """Whether a line is the record about exactly this torn end."""
    return is_torn(line) and _canonical(torn_facts(fragment))[1:-1] in line


def is_torn(line: bytes) -> bool:
    """Whether a line is a record about a torn end."""
    return line.startswith(b'{"action":"torn-line",')
