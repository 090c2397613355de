"""What goes into a bundle for who helps from afar: files of chosen places, bounded, and no secret in any of them.

Two nets: only these places are looked into, none of which holds a secret of ours; and in what is taken, every secret
that the site file points to or the store keeps is starred out, and what is called a password or a token is hidden.
"""

from __future__ import annotations

import io
import json
import os
import platform
import re
import sys
import zipfile
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from drivers.local.ownfiles import read_own
from drivers.local.scrub import masked, masked_text, without_secrets_text
from drivers.terms import shown
from gateway import audit
from gateway.audit import audit_files, read_entries
from gateway.broker import notice_of, token_path
from gateway.config import SiteFile
from gateway.push import JOURNALS
from gateway.store import Store
from gateway.store.log_book import FOLDER as LOGS
from gateway.users import first_token_path

MOST_FILE, MOST_ALL = 8_000_000, 200_000_000
AUDIT_RECORDS = 1000
LEFT = (".npy", ".f64", ".bin", ".html", ".pdf", ".png", ".svg", ".db")
"""Raw recordings, and pages that are made of what is taken."""
_TRACE = re.compile(r"\.trace(\.\d+)?$")
_POINTER = re.compile(r"_(file|env)$")


def bundle(site: SiteFile, path: Path, store: Store, *, runs: int, doctor: Mapping[str, Any]) -> bytes:
    """The zip as bytes: site file, versions, doctor, logs, audit records, journals, newest runs with their traces."""
    secrets = frozenset(_spellings(secrets_of(site, path, store.root)))
    left, told, out = MOST_ALL, list[str](), io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in _members(site, path, store, runs, doctor):
            if len(data) > min(MOST_FILE, left):
                told.append(f"{name}: left out, {len(data)} bytes")
                continue
            left -= len(data)
            made.writestr(name, _clean(name, data, secrets))
        made.writestr("contents.txt", _clean("contents.txt", "\n".join([*made.namelist(), *told]).encode(), secrets))
    return out.getvalue()


def _clean(name: str, data: bytes, secrets: frozenset[bytes]) -> bytes:
    found = masked(data, secrets)
    if _TRACE.search(name):
        return found  # hidden when it was kept; the lengths in it must stay
    if name.endswith(".toml"):
        return without_secrets_text(found.decode("utf-8", "replace")).encode("utf-8")
    return masked_text(found)


def _members(
    site: SiteFile, path: Path, store: Store, runs: int, doctor: Mapping[str, Any]
) -> Iterator[tuple[str, bytes]]:
    yield f"sites/{path.name}", read_own(path)
    yield "site-as-read.json", _json(site.model_dump(mode="json"))
    yield "versions.json", _json(versions())
    yield "doctor.json", _json(doctor)
    for found in sorted((store.root / LOGS).glob("trueflank.log*")):
        yield f"logs/{found.name}", read_own(found)
    records = list(read_entries(store.root))[-AUDIT_RECORDS:] if audit_files(store.root / audit.AUDIT) else []
    yield "audit.json", _json({"newest": records, "problem": str(audit.check_log(store.root).problem or "")})
    for found in _plain(store.root / JOURNALS):
        yield f"journal/{found.relative_to(store.root / JOURNALS).as_posix()}", read_own(found)
    for run_id in reversed(store.newest(runs)):
        for found in _plain(store.root / run_id):
            yield f"runs/{run_id}/{found.relative_to(store.root / run_id).as_posix()}", read_own(found)


def _plain(folder: Path) -> Iterator[Path]:
    """Files of a folder but for pictures and raw recordings; no link is followed."""
    for found in sorted(folder.rglob("*")):
        if found.is_file() and not found.is_symlink() and found.suffix not in LEFT:
            yield found


def _json(data: object) -> bytes:
    return json.dumps(data, indent=1, default=str).encode("utf-8")


def versions() -> dict[str, Any]:
    """Python, system, and every installed package."""
    packages = {str(one.metadata["Name"]): one.version for one in metadata.distributions()}
    return {
        "trueflank": metadata.version("trueflank"),
        "python": sys.version,
        "system": shown(platform.platform()),
        "packages": dict(sorted(packages.items())),
    }


def secrets_of(site: SiteFile, path: Path, root: Path) -> Iterator[str]:
    """Every secret that the site file points to, or that the store keeps."""
    yield from _pointed(site.model_dump(mode="json"), path.parent)
    for place in (token_path(root), first_token_path(root)):
        yield from _lines(place)
    notice = notice_of(root)
    if notice is not None:
        yield notice.token
    yield from (value for value in _hashes(root) if value)


def _hashes(root: Path) -> Iterator[str]:
    """Hashes of accounts are no secrets, and still nobody else's business."""
    try:
        kept = read_own(root / "service" / "users.json").decode("utf-8", "replace")
    except OSError:
        return
    yield from re.findall(r"\$argon2[^\"\s]+", kept)
    yield from re.findall(r"\b[0-9a-f]{64}\b", kept)


def _pointed(section: Mapping[str, Any], beside: Path) -> Iterator[str]:
    for key, value in section.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Mapping):
                yield from _pointed(one, beside)
        if isinstance(value, str) and value and _POINTER.search(key):
            yield from _lines(beside / value) if key.endswith("_file") else (os.environ.get(value, ""),)
        elif isinstance(value, str) and value and key in ("password", "key"):
            yield from _lines(beside / value) if key == "key" else (value,)


def _lines(place: Path) -> Iterator[str]:
    """A secret's file, whole and line by line; of an address its password as well."""
    try:
        text = read_own(place).decode("utf-8", "replace").strip()
    except OSError:
        return
    yield text
    yield from text.splitlines()
    yield from re.findall(r"//[^/@\s:]*:([^/@\s]+)@", text)


def _spellings(values: Iterator[str]) -> Iterator[bytes]:
    """As it is, and as JSON spells it."""
    for value in values:
        if len(value) >= 4:
            yield value.encode("utf-8")
            yield json.dumps(value)[1:-1].encode("ascii")
