"""What is kept of machines for good: known facts, sign proofs, self-tests, set-up values; the newest one counts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drivers.clock import Clock
from drivers.local.names import stem
from drivers.message import Message
from drivers.programs import SelfTested
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.values import Sense
from gateway.domain.grinding_process import SetupProof
from gateway.domain.identity import KnownFact
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole
from gateway.tooth import SetupValues

# What machines are known by, by serial number: facts read first, and changes that a person accepted.

_IDENTITIES_FOLDER = "identity"


class IdentityBook:
    """The facts kept below a store's root; none is ever overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _IDENTITIES_FOLDER

    def all(self, serial: str) -> tuple[KnownFact, ...]:
        """Every fact of a machine in its order. Raises CorruptRecord for an altered one, FutureSchema."""
        folder = self._root / stem(serial, unique=True)
        with disk_errors(folder):
            paths = sorted(folder.glob("*.json"))
        return tuple(sorted(map(_read_identity, paths), key=lambda one: one.number))

    def keep(self, fact: KnownFact) -> Path:
        """Keep a fact for good; its file name carries its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(fact)
        folder = self._root / stem(fact.serial, unique=True)
        make_folder(folder)
        path = folder / f"{fact.number:04}-{fact.fact}-{records.sha256(data)[:16]}.json"
        write_whole(path, data)
        return path


def _read_identity(path: Path) -> KnownFact:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="identity")
    return records.decode(data, KnownFact, str(path))


# Sign proofs of machines: found again only for a machine whose whole fingerprint is the same.

_PROOFS_FOLDER = "proofs"


class ProofBook:
    """The proofs kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _PROOFS_FOLDER

    def save(self, proof: SignProof) -> Path:
        """Keep a proof for good; its file name carries its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(proof)
        folder = self._folder(proof.machine)
        make_folder(folder)
        path = folder / f"{proof.kind}-{stem(proof.output_axis)}-{records.sha256(data)[:16]}.json"
        write_whole(path, data)
        return path

    def find(self, machine: MachineIdentity, kind: str, output_axis: str) -> SignProof | None:
        """The newest proof of this very machine for a kind of table and output axis, or None.

        Raises CorruptRecord when a kept proof has been altered, FutureSchema when it is too new to read.
        """
        kept = _stored_proofs(self._folder(machine), output_axis)
        proofs = [proof for proof in kept if _fits_question(proof, machine, kind, output_axis)]
        return max(proofs, key=lambda proof: proof.date_utc, default=None)

    def sense_of(self, serial: str, output_axis: str) -> Sense | None:
        """The sense of the newest proof of an axis' cross tables, for a look without a control; None without one.

        Whether it still holds for the machine is said by `find`, before anything is written. Raises as `find`.
        """
        found = _stored_proofs(self._root / stem(serial), output_axis)
        mine = [
            one for one in found if (one.machine.serial, one.kind, one.output_axis) == (serial, "cross", output_axis)
        ]
        newest = max(mine, key=lambda proof: proof.date_utc, default=None)
        return newest.sense if newest is not None else None

    def _folder(self, machine: MachineIdentity) -> Path:
        return self._root / stem(machine.serial)


def _stored_proofs(folder: Path, output_axis: str) -> list[SignProof]:
    with disk_errors(folder):
        paths = sorted(folder.glob(f"*-{stem(output_axis)}-*.json"))
    return [_read_proof(path) for path in paths]


def _fits_question(proof: SignProof, machine: MachineIdentity, kind: str, output_axis: str) -> bool:
    same = not proof.machine.differences(machine)
    return same and proof.kind == kind and proof.output_axis == output_axis


def _read_proof(path: Path) -> SignProof:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="sign proof")
    return records.decode(data, SignProof, str(path))


# Self-tests of machines, by serial number: every one is kept, the last one counts.

_SELF_TESTS_FOLDER = "self-tests"


class SelfTestBook:
    """The self-tests kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _SELF_TESTS_FOLDER

    def save(self, test: SelfTested) -> Path:
        """Keep a self-test for good; its file name carries its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(test)
        folder = self._root / stem(test.machine.serial)
        make_folder(folder)
        path = folder / f"{stem(test.axis)}-{records.sha256(data)[:16]}.json"
        write_whole(path, data)
        return path

    def last(self, machine: MachineIdentity, axis: str, encoder: int) -> SelfTested | None:
        """The newest of this axis and measuring system: of this very machine, else of what it was before; or None.

        Raises CorruptRecord when a kept one has been altered, FutureSchema when it is too new to read.
        """
        found = [one for one in self.all(machine.serial) if (one.axis, one.encoder) == (axis, encoder)]
        same = [one for one in found if not one.machine.differences(machine)]
        return max(same or found, key=lambda one: one.utc, default=None)

    def without(self, machine: MachineIdentity) -> tuple[str, ...]:
        """Words that this very machine does not take, by the newest test of each of its axes. Raises as `last`."""
        newest = {
            (one.axis, one.encoder): one for one in self.all(machine.serial) if not one.machine.differences(machine)
        }
        return tuple(dict.fromkeys(word for one in newest.values() for word in one.without))

    def all(self, serial: str) -> tuple[SelfTested, ...]:
        """Every self-test of a machine, oldest first. Raises as `last`."""
        folder = self._root / stem(serial)
        with disk_errors(folder):
            paths = sorted(folder.glob("*.json"))
        return tuple(sorted(map(_read_self_test, paths), key=lambda one: one.utc))


def _read_self_test(path: Path) -> SelfTested:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="self-test")
    return records.decode(data, SelfTested, str(path))


# Set-up values of a machine and a gear, apart from its tables: what is set now, and everything that was.

_SETUPS_FOLDER = "set-up-values"


@dataclass(frozen=True, slots=True)
class SetupEntry:
    """Set-up values as they were saved: for which machine and gear, by which run, when; ``number`` counts from 1."""

    machine: MachineIdentity
    gear: str
    setup: SetupValues
    run: str
    date_utc: str
    number: int


class SetupBook:
    """The set-up values kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _SETUPS_FOLDER

    def current(self, machine: MachineIdentity | str, gear: str) -> SetupValues:
        """What was saved last for this machine (or its serial number) and gear; zeros where nothing was.

        Raises CorruptRecord (E-STORE-HASH) when a kept record has been altered, FutureSchema, StoreError.
        """
        kept = self.history(machine, gear)
        return kept[-1].setup if kept else SetupValues()

    def history(self, machine: MachineIdentity | str, gear: str) -> tuple[SetupEntry, ...]:
        """Everything saved for this machine and gear, oldest first. Raises as `current`."""
        serial = machine if isinstance(machine, str) else machine.serial
        folder = self._folder(serial)
        with disk_errors(folder):
            paths = sorted(folder.glob(f"{stem(gear)}-*.json"))
        found = [entry for entry in map(_read_setup, paths) if (entry.machine.serial, entry.gear) == (serial, gear)]
        return tuple(sorted(found, key=lambda entry: (entry.number, entry.date_utc)))

    def save(self, machine: MachineIdentity, gear: str, setup: SetupValues, *, run: str, clock: Clock) -> SetupEntry:
        """Keep what is set from now on, durable on return. Raises StoreError (E-STORE-DISK), and as `current`."""
        kept = self.history(machine, gear)
        date = clock.utc().isoformat(timespec="seconds")
        entry = SetupEntry(
            machine=machine, gear=gear, setup=setup, run=run, date_utc=date, number=kept[-1].number + 1 if kept else 1
        )
        data = records.encode(entry)
        folder = self._folder(machine.serial)
        make_folder(folder)
        write_whole(folder / f"{stem(gear)}-{entry.number:04d}-{records.sha256(data)[:16]}.json", data)
        return entry

    def _folder(self, serial: str) -> Path:
        return self._root / stem(serial)


def _read_setup(path: Path) -> SetupEntry:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="set-up values")
    return records.decode(data, SetupEntry, str(path))


# Senses of the numbers that the builder's cycle takes its set-up values from, proved by a known step.


class SetupProofBook:
    """The proofs kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / "setup-senses"

    def save(self, proof: SetupProof) -> Path:
        """Keep a proof for good; its file name carries its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(proof)
        folder = self._root / stem(proof.machine.serial)
        make_folder(folder)
        path = folder / f"{stem(proof.name)}-{records.sha256(data)[:16]}.json"
        write_whole(path, data)
        return path

    def of(self, machine: MachineIdentity) -> tuple[SetupProof, ...]:
        """The proofs of this very machine, the newest first. Raises CorruptRecord (E-STORE-HASH), FutureSchema."""
        folder = self._root / stem(machine.serial)
        with disk_errors(folder):
            paths = sorted(folder.glob("*.json"))
        found = [one for one in map(_read_setup_proof, paths) if not one.machine.differences(machine)]
        return tuple(sorted(found, key=lambda one: one.date_utc, reverse=True))


def _read_setup_proof(path: Path) -> SetupProof:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage=Message.of("W-STORE-SENSE"))
    return records.decode(data, SetupProof, str(path))
