"""Sign proofs of machines: found again only for a machine whose whole fingerprint is the same."""

from __future__ import annotations

from pathlib import Path

from drivers.local.names import stem
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.values import Sense
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole

_FOLDER = "proofs"


class Proofs:
    """The proofs kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _FOLDER

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
        kept = _kept(self._folder(machine), output_axis)
        proofs = [proof for proof in kept if _fits(proof, machine, kind, output_axis)]
        return max(proofs, key=lambda proof: proof.date_utc, default=None)

    def sense_of(self, serial: str, output_axis: str) -> Sense | None:
        """The sense of the newest proof of an axis' cross tables, for a look without a control; None without one.

        Whether it still holds for the machine is said by `find`, before anything is written. Raises as `find`.
        """
        found = _kept(self._root / stem(serial), output_axis)
        mine = [
            one for one in found if (one.machine.serial, one.kind, one.output_axis) == (serial, "cross", output_axis)
        ]
        newest = max(mine, key=lambda proof: proof.date_utc, default=None)
        return newest.sense if newest is not None else None

    def _folder(self, machine: MachineIdentity) -> Path:
        return self._root / stem(machine.serial)


def _kept(folder: Path, output_axis: str) -> list[SignProof]:
    with disk_errors(folder):
        paths = sorted(folder.glob(f"*-{stem(output_axis)}-*.json"))
    return [_read(path) for path in paths]


def _fits(proof: SignProof, machine: MachineIdentity, kind: str, output_axis: str) -> bool:
    same = not proof.machine.differences(machine)
    return same and proof.kind == kind and proof.output_axis == output_axis


def _read(path: Path) -> SignProof:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="sign proof")
    return records.decode(data, SignProof, str(path))
