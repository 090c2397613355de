"""The notice that a serving gateway leaves in each of its state folders: its process, port and password of the day."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from drivers.local.ownfiles import open_own, read_own
from gateway.errors import StoreError

NOTICE_FILE = "broker.json"
LARGEST = 4096


@dataclass(frozen=True, slots=True)
class BrokerNotice:
    """Where a broker listens on loopback; ``token`` is drawn anew at each start."""

    pid: int
    port: int
    token: str


def notice_of(root: Path) -> BrokerNotice | None:
    """The notice in a state folder; None where nobody left one, or it cannot be read as one."""
    try:
        kept = json.loads(read_own(root / NOTICE_FILE)[:LARGEST])
        return BrokerNotice(int(kept["pid"]), int(kept["port"]), str(kept["token"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


@contextmanager
def noticed(root: Path, notice: BrokerNotice) -> Iterator[None]:
    """Leave the notice while the block lasts; for its owner's eyes alone. Raises StoreError (E-WEB-STATE)."""
    path = root / NOTICE_FILE
    try:
        path.unlink(missing_ok=True)
        with open_own(path, "xb", secret=True) as file:
            file.write(json.dumps(asdict(notice)).encode("ascii"))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise StoreError("E-WEB-STATE", str(path), why=error.strerror or str(error)) from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
