"""Run folders, the machines' sign proofs, self-tests and set-up values: what is stored stays what it was.

`machine_books`, `log_book` and `raw_stream` are called by their modules: the records of the books come with half of a
controller's, and whoever only reads a run pays for none of them.
"""

from __future__ import annotations

from gateway.store.disk import checked_name, disk_errors, make_folder, read_whole, replace, write_whole
from gateway.store.folder import (
    APPROVALS,
    RUN_FILE,
    Kind,
    RunFolder,
    RunSummary,
    digest_of,
    sealed_hashes,
    stored_place,
)
from gateway.store.maps import Maps, Said, Value
from gateway.store.records import canonical, decode, encode, sha256
from gateway.store.runs import ANYTHING, LATEST, MEASURES, Needs, Store

__all__ = [
    "ANYTHING",
    "APPROVALS",
    "LATEST",
    "MEASURES",
    "RUN_FILE",
    "Kind",
    "Maps",
    "Needs",
    "RunFolder",
    "RunSummary",
    "Said",
    "Store",
    "Value",
    "canonical",
    "checked_name",
    "decode",
    "digest_of",
    "disk_errors",
    "encode",
    "make_folder",
    "read_whole",
    "replace",
    "sealed_hashes",
    "sha256",
    "stored_place",
    "write_whole",
]
