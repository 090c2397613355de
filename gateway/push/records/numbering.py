"""Transaction numbers: four digits of the store's own and a count, given once, each exact in an R parameter."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from drivers.local.ownfiles import open_own, read_own
from gateway.errors import StoreError
from gateway.push.records.journal import numbers, sync_folder

PART_SIZE = 100_000  # a number is the store's part and a count: 4 and 5 digits
MAX_COUNT = PART_SIZE - 1
MAX_NUMBER = 9999 * PART_SIZE + MAX_COUNT
OLD_MAX = 999_999  # numbers once had no part
PART = ".part"  # no serial number makes a folder of this name
_FIRST_PART, _PARTS = 1000, 9000


def allocate(folder: Path, seed: int) -> int:
    """The next transaction number of a machine, durable before it is used; an R parameter holds it exactly.

    Its first four digits are the store's own, so that two stores give no number twice. ``seed`` begins the count
    where none was ever kept, so that a lost folder does not repeat numbers that the control may still hold.
    Raises StoreError (E-PUSH-DISK).
    """
    counter = folder / "number"
    try:
        part = _part(folder.parent)
        last = max([_kept(counter), *_used(folder)], default=0)
        count = last % PART_SIZE if last else seed % (PART_SIZE // 2)
        while True:
            count = count % MAX_COUNT + 1
            number = part * PART_SIZE + count
            if not (folder / f"tx-{number}.jnl").exists() and not (folder / "done" / f"tx-{number}.jnl").exists():
                break
        _keep(counter, number)
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(counter), why=str(error)) from error
    return number


def is_ours(folder: Path, number: int) -> bool:
    """Whether the store that a machine's journals are kept in gave this number, by the part it carries."""
    kept = _kept(folder.parent / PART)
    return _FIRST_PART <= kept == number // PART_SIZE


def _part(root: Path) -> int:
    """The store's own part of its numbers, drawn once and kept."""
    kept = _kept(root / PART)
    if not _FIRST_PART <= kept < _FIRST_PART + _PARTS:
        kept = _FIRST_PART + secrets.randbelow(_PARTS)
        _keep(root / PART, kept)
    return kept


def _kept(counter: Path) -> int:
    try:
        text = read_own(counter).decode("ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return 0
    return int(text) if text.isdigit() and int(text) <= MAX_NUMBER else 0


def _used(folder: Path) -> list[int]:
    """Numbers of all journals; only asked for when the counter was lost or runs behind."""
    return [] if _kept(folder / "number") else sorted(numbers(folder))


def _keep(counter: Path, number: int) -> None:
    temporary = counter.with_name(f".number.{secrets.token_hex(4)}")
    with open_own(temporary, "xb") as file:
        file.write(str(number).encode("ascii"))
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, counter)
    sync_folder(counter.parent)
