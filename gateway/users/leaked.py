"""Passwords that are known to have leaked, looked up in a list on this computer: nothing is asked of a network.

The list has SHA-1 hashes in upper case with counts, ``HASH:COUNT``: one file whose lines are sorted by hash, or a
folder of files named by the first five digits, each with the rest of the hashes (``SUFFIX:COUNT``). Both are what the
public downloader of Have I Been Pwned writes. SHA-1 is the list's own name of a password, nothing is kept by it here.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

from gateway.errors import StoreError
from gateway.store import disk_errors

PREFIX, MOST_LINE, MOST_FILE = 5, 100, 1 << 22


def is_leaked(password: str, listed: Path) -> bool:
    """Whether a list has a password. Raises StoreError (E-USER-LIST: no such list; E-STORE-DISK)."""
    digest = hashlib.sha1(password.encode("utf-8"), usedforsecurity=False).hexdigest().upper()
    with disk_errors(listed):
        if listed.is_dir():
            return _in_part(digest, listed)
        if not listed.is_file():
            raise StoreError("E-USER-LIST", str(listed))
        with listed.open("rb") as file:
            return _in_sorted(digest.encode("ascii"), file)


def _in_part(digest: str, folder: Path) -> bool:
    part = folder / f"{digest[:PREFIX]}.txt"
    if not part.is_file():
        raise StoreError("E-USER-LIST", str(part))
    with part.open("rb") as file:
        lines = file.read(MOST_FILE).upper().split(b"\n")
    return digest[PREFIX:].encode("ascii") in {line.partition(b":")[0].strip() for line in lines}


def _in_sorted(digest: bytes, file: BinaryIO) -> bool:
    """Halves the file until the line can only be the next one: a list has a thousand million of them."""
    low, high = 0, file.seek(0, 2)
    while low < high:
        middle = (low + high) // 2
        file.seek(middle)
        if middle:
            file.readline(MOST_LINE)
        line = file.readline(MOST_LINE).strip().upper()
        if line.startswith(digest):
            return True
        if not line or line > digest:
            high = middle
        else:
            low = middle + 1
    file.seek(low)
    return file.readline(MOST_LINE).strip().upper().startswith(digest)
