"""What machines are known by, by serial number: facts read first, and changes that a person accepted."""

from __future__ import annotations

from pathlib import Path

from drivers.local.names import stem
from gateway.domain.identity import KnownFact
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole

_FOLDER = "identity"


class IdentityBook:
    """The facts kept below a store's root; none is ever overwritten."""

    def __init__(self, root: Path) -> None:
        self._root = Path(root) / _FOLDER

    def all(self, serial: str) -> tuple[KnownFact, ...]:
        """Every fact of a machine in its order. Raises CorruptRecord for an altered one, FutureSchema."""
        folder = self._root / stem(serial, unique=True)
        with disk_errors(folder):
            paths = sorted(folder.glob("*.json"))
        return tuple(sorted(map(_read, paths), key=lambda one: one.number))

    def keep(self, fact: KnownFact) -> Path:
        """Keep a fact for good; its file name carries its hash. Raises StoreError (E-STORE-DISK)."""
        data = records.encode(fact)
        folder = self._root / stem(fact.serial, unique=True)
        make_folder(folder)
        path = folder / f"{fact.number:04}-{fact.fact}-{records.sha256(data)[:16]}.json"
        write_whole(path, data)
        return path


def _read(path: Path) -> KnownFact:
    data = read_whole(path)
    if path.stem.rpartition("-")[2] != records.sha256(data)[:16]:
        raise CorruptRecord("E-STORE-HASH", str(path), stage="identity")
    return records.decode(data, KnownFact, str(path))
