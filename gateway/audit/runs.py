"""Are the run folders of a store as they were kept? Their seals, their approvals, and the heads they name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import words
from gateway.audit.entries import ChainHead, head_of
from gateway.audit.standing import standing
from gateway.errors import StoreError
from gateway.push.records import journal
from gateway.store import RunFolder, Store
from gateway.store.seal import APPROVALS, Kind, digest_of

_CODES: Mapping[Kind, str] = {"changed": "W-SEAL-CHANGED", "missing": "W-SEAL-MISSING", "added": "W-SEAL-ADDED"}


@dataclass(frozen=True, slots=True)
class Kept:
    """What a store's files say: the heads of the audit log that they name, and what is wrong with them, in words."""

    runs: int
    heads: tuple[ChainHead, ...]
    problems: tuple[str, ...]


def look(root: Path) -> Kept:
    """Read every run folder and journal below ``root``; changes nothing. Raises StoreError (E-STORE-DISK)."""
    known = standing(root)
    heads: set[ChainHead] = set()
    problems: list[str] = []
    summaries = Store(root).runs()
    for summary in summaries:
        try:
            folder = RunFolder(summary.path)
            heads |= {head_of(folder.anchor)} if folder.anchor else set()
            problems += _problems(folder, known.approved)
        except StoreError as error:
            problems.append(str(error))
    for found in _journals(root):
        heads |= {head_of(str(found.latest("audit")))} if found.latest("audit") else set()
        problems += [words("W-SEAL-JOURNAL", file=str(found.path), why=found.broken)] if found.broken else []
    return Kept(len(summaries), tuple(sorted(heads, key=lambda head: (head.seq, head.hash))), tuple(problems))


def _journals(root: Path) -> tuple[journal.JournalRead, ...]:
    """Journals of every machine; one that is empty though the log knows its transaction is broken."""
    folders = [path for path in (root / journal.JOURNALS).glob("*") if path.is_dir()]
    begun = standing(root).begun
    every = (one for folder in folders for one in (*journal.all_of(folder), *journal.all_of(folder / "done")))
    return tuple(journal.judged(one, begun.__contains__) for one in every)


def _problems(folder: RunFolder, approved: set[str]) -> list[str]:
    told = {"run": folder.run_id}
    found = [words(_CODES[one.kind], file=one.name, **told) for one in folder.differences()]
    approvals = sorted((folder.path / APPROVALS).glob("*.json"))
    unknown = [path for path in approvals if digest_of(path) not in approved]
    return [*found, *(words("W-SEAL-APPROVAL", file=path.name, **told) for path in unknown)]
