"""Is the log whole? Every line's hash, number and predecessor, its kept head, and heads exported earlier."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import words
from gateway.audit.chain import AUDIT, HEAD, content, file_name, files, head_in, kept_text
from gateway.audit.entries import ChainHead, follows, is_torn, speaks_of
from gateway.errors import CorruptRecord, StoreError


@dataclass(frozen=True, slots=True)
class Problem:
    """The first thing that is wrong with a log: a catalogue code with its fields."""

    code: str
    fields: Mapping[str, object]

    @property
    def words(self) -> str:
        """The problem as people read it."""
        return words(self.code, **self.fields)


def problem(code: str, **fields: object) -> Problem:
    """A problem with its fields."""
    return Problem(code, fields)


@dataclass(frozen=True, slots=True)
class Health:
    """A checked log: how many records and files were sound, its head, the torn end no record speaks of yet."""

    head: ChainHead
    files: int = 0
    torn_bytes: int = 0
    problem: Problem | None = None

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong; a torn end after a crash is not wrong, the next record will speak of it."""
        return self.problem is None

    def as_data(self) -> dict[str, object]:
        """The result as JSON data."""
        why = self.problem.words if self.problem is not None else ""
        told = {"sound": self.sound, "records": self.head.seq, "head": str(self.head), "files": self.files}
        return {**told, "torn_bytes": self.torn_bytes, "problem": why}


@dataclass(slots=True)
class _Walk:
    """A check on its way along the log."""

    kept: ChainHead | None
    exported: set[str]
    numbered: Mapping[int, str]
    head: ChainHead = field(default_factory=ChainHead)
    fragment: bytes = b""

    def take(self, name: str, data: bytes) -> Problem | None:
        """One file; its first problem, if any."""
        *lines, rest = data.split(b"\n")
        for number, line in enumerate(lines, 1):
            found = self._line(line, name, number)
            if found is not None:
                return found
        self.fragment += rest
        return None

    def _line(self, line: bytes, name: str, number: int) -> Problem | None:
        record = self.head.seq + 1
        head = follows(line, self.head)
        if head is None:
            return problem("W-AUDIT-LINE", file=name, line=number, record=record)
        if (self.fragment or is_torn(line)) and not speaks_of(line, self.fragment):
            return problem("W-AUDIT-TORN", file=name, line=number, record=record)
        if self.kept is not None and head.seq == self.kept.seq and head != self.kept:
            return problem("W-AUDIT-KEPT", head=self.kept, found=head)
        if self.numbered.get(head.seq, head.hash) != head.hash:
            return problem("W-AUDIT-EXPORT", head=ChainHead(head.seq, self.numbered[head.seq]), found=head)
        self.head, self.fragment = head, b""
        self.exported.discard(head.hash)
        return None

    def end(self) -> Problem | None:
        """What is missing once all files have been seen."""
        if self.kept is not None and self.kept.seq == 0 and self.kept != ChainHead():
            return problem("W-AUDIT-DAMAGED-HEAD", found=self.kept)
        if self.kept is None and (self.head.seq or self.fragment):
            return problem("W-AUDIT-NO-HEAD", file=HEAD)
        if self.kept is not None and self.kept.seq > self.head.seq:
            return problem("W-AUDIT-KEPT", head=self.kept, found=self.head)
        if self.exported:
            return problem("W-AUDIT-EXPORT", head=", ".join(sorted(self.exported)), found=self.head)
        return None


def judge(kept: bytes | None, parts: Iterable[tuple[str, bytes]], exported: tuple[ChainHead, ...] = ()) -> Health:
    """The verdict on a log given as its head file (None: missing) and its files, (name, content) in order; pure."""
    try:
        known = head_in(kept) if kept is not None else None
    except CorruptRecord as error:
        return Health(ChainHead(), problem=problem("W-AUDIT-DAMAGED-HEAD", found=error.fields.get("found", "")))
    numbered = {head.seq: head.hash for head in exported if head.seq}
    walk, number = _Walk(known, {head.hash for head in exported}, numbered), 0
    for number, (name, data) in enumerate(parts, 1):
        wanted = file_name(number)
        first = walk.take(name, data) if name == wanted else problem("W-AUDIT-FILE", file=wanted)
        if first is not None:
            return Health(walk.head, number, problem=first)
    return Health(walk.head, number, len(walk.fragment), walk.end())


def check(root: Path, exported: tuple[ChainHead, ...] = ()) -> Health:
    """Read the whole log below ``root`` against the heads exported from it earlier; changes nothing.

    Raises StoreError (E-STORE-DISK) when it cannot be read.
    """
    folder = root / AUDIT
    return judge(kept_text(folder), ((path.name, content(path)) for path in files(folder)), exported)


def sound(root: Path) -> bool:
    """Whether writes may be allowed: the log is whole and can be read. Never raises."""
    try:
        return check(root).sound
    except StoreError:
        return False


def demand(root: Path, exported: tuple[ChainHead, ...] = ()) -> Health:
    """The same as `check`, but a log that is not whole raises CorruptRecord (E-AUDIT-BROKEN)."""
    health = check(root, exported)
    if health.problem is not None:
        raise CorruptRecord("E-AUDIT-BROKEN", str(root / AUDIT), why=health.problem.words)
    return health
