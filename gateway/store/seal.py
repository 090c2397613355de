"""The seal of a run folder: which files it must hold, by their hashes, and what is not so."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from drivers.local.ownfiles import open_own
from gateway.store.disk import disk_errors
from gateway.store.layout import place

BESIDE = "beside"
# Two people write approvals at the same time: they stand beside the seal, and the audit log knows each by its hash.
APPROVALS = "approvals"
_BLOCK = 1 << 20
Kind = Literal["changed", "missing", "added"]


@dataclass(frozen=True, slots=True)
class Difference:
    """One file of a run folder that is not as its seal says; ``name`` is relative to the folder."""

    name: str
    kind: Kind


def digest_of(path: Path) -> str:
    """sha256 of a file, piece by piece. Raises StoreError (E-STORE-DISK)."""
    digest = hashlib.sha256()
    with disk_errors(path), open_own(path, "rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def sealed(facts: Mapping[str, Any]) -> dict[str, str]:
    """Hashes by name of every file that a run's facts name."""
    stages = {place(entry["file"], facts): entry["sha256"] for entry in facts["stages"].values()}
    files = {place(name, facts): digest for name, digest in facts["files"].items()}
    return {**facts.get(BESIDE, {}), **files, **stages}


def compare(folder: Path, facts: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Every difference between a folder and its seal, by name. Raises StoreError (E-STORE-DISK).

    A run from before all files were sealed is not asked for what it does not name.
    """
    wanted = sealed(facts)
    found = {name for name in _names(folder) if BESIDE in facts or name in wanted}
    differences = [Difference(name, "added") for name in found - set(wanted)]
    differences += [Difference(name, "missing") for name in set(wanted) - found]
    changed = (name for name in found & set(wanted) if digest_of(folder / name) != wanted[name])
    differences += [Difference(name, "changed") for name in changed]
    return tuple(sorted(differences, key=lambda one: one.name))


def _names(folder: Path) -> set[str]:
    """The files of a folder but for run.json, which is its own seal, and what a crash left half written."""
    with disk_errors(folder):
        paths = [path for path in folder.rglob("*") if path.is_file()]
    names = {path.relative_to(folder).as_posix() for path in paths if not path.name.startswith(".")}
    return {name for name in names if name != "run.json" and not name.startswith(f"{APPROVALS}/")}
