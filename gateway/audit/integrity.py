"""Is the log whole? Hash, number and predecessor of each line, its kept head, exported heads, what run folders name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import words
from gateway.audit.chain import (
    AUDIT,
    HEAD,
    ChainHead,
    audit_files,
    describes_fragment,
    file_name,
    is_torn_record,
    next_head,
    parse_head,
    parse_head_file,
    read_head_file,
    read_log_file,
)
from gateway.audit.log_state import read_log_state
from gateway.errors import CorruptRecord, StoreError
from gateway.push import JOURNALS, JournalRead, mark_emptied, read_journals
from gateway.store import APPROVALS, Kind, RunFolder, Store, digest_of


@dataclass(frozen=True, slots=True)
class Problem:
    """The first thing that is wrong with a log: a catalogue code with its fields."""

    code: str
    fields: Mapping[str, object]

    @property
    def words(self) -> str:
        """The problem as people read it."""
        return words(self.code, **self.fields)


def make_problem(code: str, **fields: object) -> Problem:
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
class _LogCheck:
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
        head = next_head(line, self.head)
        if head is None:
            return make_problem("W-AUDIT-LINE", file=name, line=number, record=record)
        if (self.fragment or is_torn_record(line)) and not describes_fragment(line, self.fragment):
            return make_problem("W-AUDIT-TORN", file=name, line=number, record=record)
        if self.kept is not None and head.seq == self.kept.seq and head != self.kept:
            return make_problem("W-AUDIT-KEPT", head=self.kept, found=head)
        if self.numbered.get(head.seq, head.hash) != head.hash:
            return make_problem("W-AUDIT-EXPORT", head=ChainHead(head.seq, self.numbered[head.seq]), found=head)
        self.head, self.fragment = head, b""
        self.exported.discard(head.hash)
        return None

    def end(self) -> Problem | None:
        """What is missing once all files have been seen."""
        if self.kept is not None and self.kept.seq == 0 and self.kept != ChainHead():
            return make_problem("W-AUDIT-DAMAGED-HEAD", found=self.kept)
        if self.kept is None and (self.head.seq or self.fragment):
            return make_problem("W-AUDIT-NO-HEAD", file=HEAD)
        if self.kept is not None and self.kept.seq > self.head.seq:
            return make_problem("W-AUDIT-KEPT", head=self.kept, found=self.head)
        if self.exported:
            return make_problem("W-AUDIT-EXPORT", head=", ".join(sorted(self.exported)), found=self.head)
        return None


def judge_log(kept: bytes | None, parts: Iterable[tuple[str, bytes]], exported: tuple[ChainHead, ...] = ()) -> Health:
    """The verdict on a log given as its head file (None: missing) and its files, (name, content) in order; pure."""
    try:
        known = parse_head_file(kept) if kept is not None else None
    except CorruptRecord as error:
        return Health(ChainHead(), problem=make_problem("W-AUDIT-DAMAGED-HEAD", found=error.fields.get("found", "")))
    numbered = {head.seq: head.hash for head in exported if head.seq}
    walk, number = _LogCheck(known, {head.hash for head in exported}, numbered), 0
    for number, (name, data) in enumerate(parts, 1):
        wanted = file_name(number)
        first = walk.take(name, data) if name == wanted else make_problem("W-AUDIT-FILE", file=wanted)
        if first is not None:
            return Health(walk.head, number, problem=first)
    return Health(walk.head, number, len(walk.fragment), walk.end())


def check_log(root: Path, exported: tuple[ChainHead, ...] = ()) -> Health:
    """Read the whole log below ``root`` against the heads exported from it earlier; changes nothing.

    Raises StoreError (E-STORE-DISK) when it cannot be read.
    """
    folder = root / AUDIT
    return judge_log(
        read_head_file(folder), ((path.name, read_log_file(path)) for path in audit_files(folder)), exported
    )


def is_sound(root: Path) -> bool:
    """Whether writes may be allowed: the log is whole and can be read. Never raises."""
    try:
        return check_log(root).sound
    except StoreError:
        return False


def require_sound(root: Path, exported: tuple[ChainHead, ...] = ()) -> Health:
    """The same as `check_log`, but a log that is not whole raises CorruptRecord (E-AUDIT-BROKEN)."""
    health = check_log(root, exported)
    if health.problem is not None:
        raise CorruptRecord("E-AUDIT-BROKEN", str(root / AUDIT), why=health.problem.words)
    return health


# Run folders and journals name heads of the log, so a log that was cut shows there.

_CODES: Mapping[Kind, str] = {"changed": "W-SEAL-CHANGED", "missing": "W-SEAL-MISSING", "added": "W-SEAL-ADDED"}


@dataclass(frozen=True, slots=True)
class StoreCheck:
    """What a store's files say: the heads of the audit log that they name, and what is wrong with them, in words."""

    runs: int
    heads: tuple[ChainHead, ...]
    problems: tuple[str, ...]


def check_store(root: Path) -> StoreCheck:
    """Read every run folder and journal below ``root``; changes nothing. Raises StoreError (E-STORE-DISK)."""
    known = read_log_state(root)
    heads: set[ChainHead] = set()
    problems: list[str] = []
    summaries = Store(root).runs()
    for summary in summaries:
        try:
            folder = RunFolder(summary.path)
            heads |= {parse_head(folder.anchor)} if folder.anchor else set()
            problems += _folder_problems(folder, known.approved)
        except StoreError as error:
            problems.append(str(error))
    for found in _journals(root):
        heads |= {parse_head(str(found.latest("audit")))} if found.latest("audit") else set()
        problems += [words("W-SEAL-JOURNAL", file=str(found.path), why=found.broken)] if found.broken else []
    return StoreCheck(len(summaries), tuple(sorted(heads, key=lambda head: (head.seq, head.hash))), tuple(problems))


def _journals(root: Path) -> tuple[JournalRead, ...]:
    """Journals of every machine; one that is empty though the log knows its transaction is broken."""
    folders = [path for path in (root / JOURNALS).glob("*") if path.is_dir()]
    begun = read_log_state(root).begun
    every = (one for folder in folders for one in (*read_journals(folder), *read_journals(folder / "done")))
    return tuple(mark_emptied(one, begun.__contains__) for one in every)


def _folder_problems(folder: RunFolder, approved: Collection[str]) -> list[str]:
    told = {"run": folder.run_id}
    found = [words(_CODES[one.kind], file=one.name, **told) for one in folder.differences()]
    approvals = sorted((folder.path / APPROVALS).glob("*.json"))
    unknown = [path for path in approvals if digest_of(path) not in approved]
    return [*found, *(words("W-SEAL-APPROVAL", file=path.name, **told) for path in unknown)]
