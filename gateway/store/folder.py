"""Run folders: every stage of a run as one hashed file, `run.json` naming them all, and the seal over its files."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.errors import words
from drivers.local.names import is_file_name, shown
from drivers.local.ownfiles import is_link, open_own
from drivers.terms import with_current_keys
from drivers.types.identity import MachineIdentity
from gateway.errors import CorruptRecord, RecordNotFound, StoreError
from gateway.store import records
from gateway.store.disk import checked_name, disk_errors, make_folder, read_whole, write_whole

# Run folders: every stage of a run as one hashed file, `run.json` naming them all.

R = TypeVar("R")
RUN_FILE = "run.json"


@dataclass(frozen=True, slots=True)
class RunSummary:
    """One line of the list of runs; ``problem`` says why a run cannot be read ("" when it can).

    ``seal`` is the sha256 of `run.json` as it was read.
    """

    run_id: str
    path: Path
    site: str = ""
    created_utc: str = ""
    state: str = ""
    machine: str = ""
    software: str = ""
    stages: tuple[str, ...] = ()
    problem: str = ""
    seal: str = ""


class RunFolder:
    """One run on disk. Stages are stored once; a stage stored again gets a new file and the old one stays."""

    def __init__(self, path: Path) -> None:
        """Raises StoreError (E-STORE-LINK) where another folder stands in for this one; CorruptRecord, FutureSchema."""
        if is_link(path):
            raise StoreError("E-STORE-LINK", str(path))
        self.path = path
        self._last: tuple[bytes, Mapping[str, Any]] = (b"", {})
        self._current_facts()

    @property
    def run_id(self) -> str:
        """Sortable id: UTC time, site name, random end."""
        return self.path.name

    @property
    def facts(self) -> Mapping[str, Any]:
        """`run.json` as read now: state, site, machine, stages, errors."""
        return self._facts()

    @property
    def errors(self) -> tuple[Mapping[str, Any], ...]:
        """What went wrong in this run, oldest first, each as `TrueflankError.as_record` gave it."""
        return tuple(records.from_plain(one) for one in self._current_facts()["errors"])

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stored stages in the order they were first stored."""
        return tuple(self._current_facts()["stages"])

    @property
    def state(self) -> str:
        """The run's state in one word."""
        return str(self._current_facts()["state"])

    @property
    def anchor(self) -> str:
        """The head that the audit log had when this run last proposed; "" where it did not."""
        return str(self._current_facts().get("audit", ""))

    def set_anchor(self, head: str) -> None:
        """Note the audit log's head, so that a log that is gone or cut is missed."""
        facts = self._facts()
        facts["audit"] = head
        self._write_facts(facts)

    @property
    def plan(self) -> Any:
        """What the run was created for, as given."""
        return records.from_plain(self._current_facts()["plan"])

    def put(self, stage: str, record: object, parents: tuple[str, ...] = ()) -> str:
        """Store a stage's record and return its sha256. ``parents`` are hashes of what it was made from.

        Raises StoreError (E-STORE-ENCODE, E-STORE-NAME, E-STORE-DISK).
        """
        data = records.encode(record, tuple(parents))
        digest = records.sha256(data)
        facts = self._facts()
        known = facts["stages"].get(checked_name(stage))
        if known is not None and known["sha256"] == digest:
            return digest
        if known is not None:
            facts.setdefault(BESIDE, {})[stored_place(known["file"], facts)] = known["sha256"]
        name = self._free_name(stage, facts)
        self._write(name, data, facts)
        entry = {"file": name, "sha256": digest, "parents": list(parents), "type": type(record).__name__}
        entry["replaces"] = [*known["replaces"], known["file"]] if known else []
        facts["stages"][stage] = entry
        self._write_facts(facts)
        return digest

    def get(self, stage: str, kind: type[R]) -> R:
        """A stage's record, its hash checked.

        Raises StoreError (E-STORE-STAGE) when never stored, CorruptRecord (E-STORE-HASH and others),
        FutureSchema.
        """
        entry = self._entry(stage)
        path = self._place(entry["file"])
        data = read_whole(path)
        if records.sha256(data) != entry["sha256"]:
            raise CorruptRecord("E-STORE-HASH", str(path), stage=stage)
        return records.decode(data, kind, str(path))

    def older(self, stage: str) -> str:
        """The version that stored a stage in words of its own; "" where it was stored in today's.

        Raises as `get`.
        """
        path = self._place(self._entry(stage)["file"])
        kept = records.open_envelope(read_whole(path), str(path))["schema"]
        return "" if kept >= records.RENAMED else str(self._current_facts()["software"])

    def envelope(self, stage: str) -> dict[str, Any]:
        """A stage as it is stored, its hash checked: schema, type, parents and record as JSON data. Raises as `get`."""
        entry = self._entry(stage)
        path = self._place(entry["file"])
        data = read_whole(path)
        if records.sha256(data) != entry["sha256"]:
            raise CorruptRecord("E-STORE-HASH", str(path), stage=stage)
        return records.open_envelope(data, str(path))

    def has(self, stage: str) -> bool:
        """Whether a stage is stored."""
        return stage in self._current_facts()["stages"]

    def digest(self, stage: str) -> str:
        """The sha256 of a stored stage. Raises StoreError (E-STORE-STAGE)."""
        return str(self._entry(stage)["sha256"])

    def parents(self, stage: str) -> tuple[str, ...]:
        """The hashes a stage was made from."""
        return tuple(self._entry(stage)["parents"])

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files beside the stages, in the order they were first kept."""
        return tuple(self._current_facts()["files"])

    def write_bytes(self, name: str, data: bytes) -> Path:
        """Store a file beside the stages under this name, durable, its hash in `run.json`."""
        facts = self._facts()
        path = self._write(checked_name(name), data, facts)
        facts["files"][name] = records.sha256(data)
        self._write_facts(facts)
        return path

    def write_text(self, name: str, text: str) -> Path:
        """Store a text exactly as given (UTF-8, line ends untouched); returns its path."""
        return self.write_bytes(name, text.encode("utf-8"))

    def write_array(self, name: str, array: NDArray[Any]) -> Path:
        """Store an array as .npy; returns its path."""
        buffer = io.BytesIO()
        np.save(buffer, array, allow_pickle=False)
        return self.write_bytes(name if name.endswith(".npy") else f"{name}.npy", buffer.getvalue())

    def adopt(self, *paths: Path) -> None:
        """Take files that others wrote into the folder (pictures, streams, traces) into its seal, as they are now.

        What is not there is left out. Raises StoreError (E-STORE-DISK).
        """
        found = {path.relative_to(self.path).as_posix(): digest_of(path) for path in paths if path.is_file()}
        if not found:
            return
        facts = self._facts()
        facts.setdefault(BESIDE, {}).update(found)
        self._write_facts(facts)

    def differences(self) -> tuple[Difference, ...]:
        """Files that are not as the seal has them: changed, missing, added. Raises StoreError, CorruptRecord."""
        return compare_seal(self.path, self._current_facts())

    def read_bytes(self, name: str) -> bytes:
        """A stored file, its hash checked. Raises StoreError (E-STORE-FILE), CorruptRecord (E-STORE-HASH)."""
        known = self._current_facts()["files"]
        if name not in known:
            raise RecordNotFound("E-STORE-FILE", str(self.path), name=name, known=", ".join(sorted(known)))
        path = self._place(name)
        data = read_whole(path)
        if records.sha256(data) != known[name]:
            raise CorruptRecord("E-STORE-HASH", str(path), stage=name)
        return data

    def read_text(self, name: str) -> str:
        """A stored text, its hash checked."""
        return self.read_bytes(name).decode("utf-8")

    def read_array(self, name: str) -> NDArray[Any]:
        """A stored array, its hash checked."""
        data = self.read_bytes(name if name.endswith(".npy") else f"{name}.npy")
        loaded: NDArray[Any] = np.load(io.BytesIO(data), allow_pickle=False)
        return loaded

    def set_state(
        self, state: str, *, error: Mapping[str, object] | None = None, machine: MachineIdentity | None = None
    ) -> None:
        """Note the run's state, and with it an error (`TrueflankError.as_record`) or the machine met."""
        facts = self._facts()
        facts["state"] = state
        if error is not None:
            facts["errors"].append(records.plain(error))
        if machine is not None:
            facts["machine"] = {"serial": machine.serial, "version": machine.version}
        self._write_facts(facts)

    def summary(self) -> RunSummary:
        """This run as one line."""
        facts = self._current_facts()
        return RunSummary(
            run_id=self.run_id,
            path=self.path,
            site=facts["site"],
            created_utc=facts["created_utc"],
            state=facts["state"],
            machine=facts["machine"].get("serial", ""),
            software=facts["software"],
            stages=tuple(facts["stages"]),
            seal=records.sha256(self._last[0]),
        )

    def _entry(self, stage: str) -> dict[str, Any]:
        stages = self._current_facts()["stages"]
        if stage not in stages:
            known = ", ".join(stages) or words("W-CFG-NONE")
            raise RecordNotFound("E-STORE-STAGE", str(self.path), stage=stage, known=known)
        return dict(stages[stage])

    def _place(self, name: object) -> Path:
        """Where a file lies that `run.json` names: in this folder. Raises CorruptRecord (E-STORE-PLACE)."""
        if not isinstance(name, str) or not is_file_name(name):
            raise CorruptRecord("E-STORE-PLACE", str(self.path), name=shown(name))
        return self.path / stored_place(name, self._current_facts())

    def _write(self, name: str, data: bytes, facts: Mapping[str, Any]) -> Path:
        path = self.path / stored_place(name, facts)
        if path.parent != self.path:
            make_folder(path.parent)
        write_whole(path, data)
        return path

    def _free_name(self, stem: str, facts: Mapping[str, Any]) -> str:
        name, number = f"{stem}.json", 2
        while (self.path / stored_place(name, facts)).exists():
            name, number = f"{stem}.{number}.json", number + 1
        return name

    def _facts(self) -> dict[str, Any]:
        return _facts_in(self.path / RUN_FILE)

    def _current_facts(self) -> Mapping[str, Any]:
        """`run.json` as it is now, only to read: its bytes are read each time, judged again only where they changed."""
        data = read_whole(self.path / RUN_FILE)
        if data != self._last[0]:
            self._last = data, _facts_in(self.path / RUN_FILE, data)
        return self._last[1]

    def _write_facts(self, facts: dict[str, Any]) -> None:
        write_whole(self.path / RUN_FILE, with_seal(facts))


def with_seal(facts: Mapping[str, Any]) -> bytes:
    """`run.json` with its own hash."""
    body = {key: value for key, value in facts.items() if key != "sha256"}
    return json.dumps({**body, "sha256": records.sha256(records.canonical(body))}, indent=1).encode("ascii")


_KEYS = ("run_id", "site", "created_utc", "state", "machine", "software", "plan", "stages", "files", "errors")


def _facts_in(path: Path, data: bytes | None = None) -> dict[str, Any]:
    facts = records.open_envelope(read_whole(path) if data is None else data, str(path))
    seal = facts.pop("sha256", "")
    if seal != records.sha256(records.canonical(facts)) or any(key not in facts for key in _KEYS):
        raise CorruptRecord("E-STORE-HASH", str(path), stage=RUN_FILE)
    return {**facts, "machine": with_current_keys(facts["machine"])}


# Where a file of a run lies in its folder: the one rule, by its name; runs kept before it lie in one folder. Pure.

KEY, TODAY = "layout", 2
SUBFOLDERS: Mapping[str, tuple[str, ...]] = {
    "captures": ("acting-", "capture-", "component-", "evaluation-", "hidden-", "source-"),
    "setups": ("setup-", "stands-"),
    "tables": ("backup-", "live-", "push-", "tables-"),
    "parts": ("grind-", "ground-", "inspected-", "part-"),
    "protocol": ("sent-",),
    "raw": ("raw-",),
}
"""Sub-folders by how names begin; what is none of them (report, results, site, proposal, verdict) lies on top."""


def stored_place(name: str, facts: Mapping[str, Any]) -> str:
    """The path of a file of this name below its run's folder, with "/"; ``facts`` are the run's own."""
    if facts.get(KEY) != TODAY:
        return name
    if name.endswith(".npy"):
        return f"raw/{name}"
    room = next((room for room, starts in SUBFOLDERS.items() if name.startswith(starts)), "")
    return f"{room}/{name}" if room else name


# The seal of a run folder: which files it must hold, by their hashes, and what is not so.

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


def sealed_hashes(facts: Mapping[str, Any]) -> dict[str, str]:
    """Hashes by name of every file that a run's facts name."""
    stages = {stored_place(entry["file"], facts): entry["sha256"] for entry in facts["stages"].values()}
    files = {stored_place(name, facts): digest for name, digest in facts["files"].items()}
    return {**facts.get(BESIDE, {}), **files, **stages}


def compare_seal(folder: Path, facts: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Every difference between a folder and its seal, by name. Raises StoreError (E-STORE-DISK).

    A run from before all files were sealed is not asked for what it does not name.
    """
    wanted = sealed_hashes(facts)
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
