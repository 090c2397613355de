"""The files that a site file names: are they there, can they be read, are they what the key asks for."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import ConfigError, words
from gateway.config import Fault, SiteReading
from gateway.config.faults import called

FILE_ROLES = ("file", "gear-file")
_OTHERS = stat.S_IRGRP | stat.S_IROTH
MOST_CERTIFICATE = 1 << 20


def disk_faults(reading: SiteReading, path: Path) -> tuple[Fault, ...]:
    """Every file that is missing or wrong; those of keys that are wrong themselves are not looked for."""
    folder, tree, site = path.parent, reading.tree, reading.seen
    found = [*_store(tree, site, folder), *_settings(tree, site, path), *_results(tree, site, folder)]
    return (*found, *_gear(tree, site, folder))


def _fault(tree: Any, place: tuple[str | int, ...], file: Path, why: str, *, doubt: bool = False) -> Fault:
    fields = {"key": called(tree, place), "file": str(file), "why": why}
    return Fault(place, "W-CFG-FILE-DOUBT" if doubt else "E-CFG-FILE", fields, doubt=doubt)


def unreadable(file: Path) -> str:
    """Why a file cannot be read, in words; "" where it can."""
    try:
        kind = file.stat()
        if not stat.S_ISREG(kind.st_mode):
            return words("W-TOML-FOLDER" if stat.S_ISDIR(kind.st_mode) else "W-TOML-NO-FILE")
        with file.open("rb") as opened:
            return "" if opened.read(1) else words("W-CFG-EMPTY")
    except (OSError, ValueError) as error:
        return (error.strerror if isinstance(error, OSError) else "") or str(error)


def _store(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    store = getattr(site.site, "store", None)
    if isinstance(store, str | Path) and (folder / store).exists() and not (folder / store).is_dir():
        yield _fault(tree, ("site", "store"), folder / store, words("W-CFG-NO-FOLDER"))


def _settings(tree: Any, site: Any, path: Path) -> Iterator[Fault]:
    for section in (site.controller, *site.instruments):
        spec = registry.known().get(section.driver) if hasattr(section, "place") else None
        model = spec.load_settings() if spec is not None else None
        if model is None or not isinstance(section.settings, Mapping):
            continue
        for key, kind in model.paths().items():
            value = section.settings.get(key)
            if isinstance(value, str) and value:
                place = (*section.place, "settings", key)
                yield from _pointed(tree, place, path, value, kind)


def _pointed(tree: Any, place: tuple[str | int, ...], path: Path, value: str, kind: str) -> Iterator[Fault]:
    file = path.parent / value
    if kind == "environment":
        if value not in os.environ:
            yield _fault(tree, place, Path(value), words("W-CFG-NOT-SET"), doubt=True)
    elif kind == "folder":
        if file.exists() and not file.is_dir():
            yield _fault(tree, place, file, words("W-CFG-NO-FOLDER"))
    elif why := unreadable(file):
        if kind == "certificate":
            fields = {"key": called(tree, place), "file": str(file), "why": why, "site": str(path)}
            yield Fault(place, "E-CFG-CERTIFICATE", fields)
        else:
            yield _fault(tree, place, file, why)
    elif kind == "certificate" and not _is_certificate(file):
        yield _fault(tree, place, file, words("W-CFG-NO-CERTIFICATE"))
    elif kind == "secret" and os.name == "posix" and file.stat().st_mode & _OTHERS:
        yield _fault(tree, place, file, words("W-CFG-OPEN-SECRET"), doubt=True)


def _is_certificate(file: Path) -> bool:
    """By its first bytes: DER begins a sequence, PEM says what it is."""
    with file.open("rb") as opened:
        first = opened.read(64).lstrip()
    return first[:1] == b"\x30" or first.startswith(b"-----BEGIN CERTIFICATE")


def _results(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    named = [(axis.measure, "file") for axis in site.axes if hasattr(axis.measure, "place")]
    named += [(setup, "path") for setup in site.setups if setup.source == "file"]
    endings = {name for role in FILE_ROLES[:1] for name in registry.known(role)}
    for section, key in named:
        value = getattr(section, key)
        if isinstance(value, str):
            file = folder / value
            why = unreadable(file)
            if not why and file.suffix.lower().lstrip(".") not in endings:
                why = words("W-CFG-ENDING", known=", ".join(f".{name}" for name in sorted(endings)))
            if why:
                yield _fault(tree, (*section.place, key), file, why)


def _gear(tree: Any, site: Any, folder: Path) -> Iterator[Fault]:
    """The gear file is read as it would be for the tooth."""
    gear = getattr(site.work, "gear", None)
    if not isinstance(gear, str):
        return
    file = folder / gear
    why = unreadable(file)
    if not why:
        from gateway.study.files import load_gear

        try:
            load_gear(file)
        except ConfigError as error:
            why = error.what
    if why:
        yield _fault(tree, ("work", "gear"), file, why)
