"""Set-up values of a machine and a gear, apart from its tables: what is set now, and everything that was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drivers.clock import Clock
from drivers.local.names import stem
from drivers.types.identity import MachineIdentity
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole
from gateway.tooth import SetupValues

_FOLDER = "set-up-values"


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
        self._root = Path(root) / _FOLDER

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
        found = [entry for entry in map(_read, paths) if (entry.machine.serial, entry.gear) == (serial, gear)]
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


def _read(path: Path) -> SetupEntry:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="set-up values")
    return records.decode(data, SetupEntry, str(path))
