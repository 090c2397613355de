"""Self-tests of machines, by serial number: every one is kept, the last one counts."""

from __future__ import annotations

from pathlib import Path

from drivers.local.names import stem
from drivers.programs import SelfTested
from drivers.types.identity import MachineIdentity
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole

_FOLDER = "self-tests"


class SelfTestBook:
    """The self-tests kept below a store's root; older ones are never overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _FOLDER

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
        return tuple(sorted(map(_read, paths), key=lambda one: one.utc))


def _read(path: Path) -> SelfTested:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="self-test")
    return records.decode(data, SelfTested, str(path))
