"""What people said once about files of others: units and columns, found again by what the files have in common."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.local.ownfiles import sync_folder
from drivers.message import Message
from gateway.errors import CorruptRecord
from gateway.store import records
from gateway.store.disk import disk_errors, make_folder, read_whole, write_whole

_FOLDER = "maps"
_KIND = re.compile(r"[a-z-]{1,20}")
Value = str | int | float | bool


@dataclass(frozen=True, slots=True)
class Said:
    """What was said about files called ``key``, and when."""

    kind: str
    key: str
    said: Mapping[str, Value]
    utc: str


class Maps:
    """The answers kept below a store's root, one small file each."""

    def __init__(self, root: Path) -> None:
        self._folder = Path(root) / _FOLDER

    def keep(self, kind: str, key: str, said: Mapping[str, Value], utc: str) -> None:
        """Remember; an older answer gives way. Raises StoreError (E-STORE-DISK)."""
        body = {"schema": records.SCHEMA, "kind": kind, "key": key, "said": dict(said), "utc": utc}
        make_folder(self._folder)
        write_whole(self._path(kind, key), records.canonical(body))

    def find(self, kind: str, key: str) -> Said | None:
        """The answer for these files, or None. Raises CorruptRecord (E-STORE-JSON), FutureSchema."""
        path = self._path(kind, key)
        with disk_errors(path):
            if not path.is_file():
                return None
            data = read_whole(path)
        body = records.open_envelope(data, str(path))
        said, utc = body.get("said"), body.get("utc")
        if not isinstance(said, dict) or not isinstance(utc, str) or (body.get("kind"), body.get("key")) != (kind, key):
            raise CorruptRecord("E-STORE-JSON", str(path), why=Message.of("W-STORE-NOT-SAID"))
        if not all(isinstance(value, Value) for value in said.values()):
            raise CorruptRecord("E-STORE-JSON", str(path), why=Message.of("W-STORE-VALUE"))
        return Said(kind, key, said, utc)

    def forget(self, kind: str, key: str) -> bool:
        """Forget an answer; false where there was none."""
        path = self._path(kind, key)
        with disk_errors(path):
            if not path.is_file():
                return False
            path.unlink()
            sync_folder(self._folder)
        return True

    def _path(self, kind: str, key: str) -> Path:
        if not _KIND.fullmatch(kind):
            raise ValueError(f"{kind!r} is no kind of answer")
        digest = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()
        return self._folder / f"{kind}-{digest[:32]}.json"
