"""Site file -> validated tree, or everything that is wrong with it, each with its place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import ConfigError, words
from drivers.local.names import guess, shown
from drivers.local.textfile import bear, decode_utf8, find_bad_numbers, read_bounded
from gateway.config.connections import without_control
from gateway.config.faults import Fault, SiteFaults, places_in, read_tree, value_at
from gateway.config.model_faults import LISTS, broken_rule, key_faults, readable_section
from gateway.config.sections import SiteFile
from gateway.config.site_rules import rule_faults

START = (1, 1)
"""Where a section is missed of which nothing stands in the file."""


@dataclass(frozen=True, slots=True)
class SiteReading:
    """A site file as far as it can be read: ``faults`` refuse it, ``doubts`` do not.

    ``site`` is None where a key is wrong; ``seen`` holds the right ones as attributes all the same, ``tree`` all.
    """

    site: SiteFile | None
    faults: tuple[Fault, ...]
    doubts: tuple[Fault, ...]
    text: str
    tree: dict[str, Any]
    seen: Any


def load_site(path: Path) -> SiteFile:
    """Read a site file; paths under a driver's settings are taken from its folder.

    Raises SiteFaults (a ConfigError with every fault: E-CFG-TOML, E-CFG-KEY, E-CFG-VALUE, E-CFG-DRIVER,
    E-CFG-SETTING, E-CFG-SETTING-VALUE), ConfigError (E-CFG-READ, E-CFG-ENCODING).
    """
    reading = read_site(path)
    faults = tuple(fault for fault in reading.faults if not fault.later)
    if reading.site is None or faults:
        raise SiteFaults(str(path), faults)
    return with_absolute_paths(reading.site, path.parent)


def site_of(tree: dict[str, Any], where: str) -> SiteFile:
    """The site of a tree that was no file, by the same rules. Raises SiteFaults."""
    site, found = _judge(tree, partial=False)
    faults = tuple(fault for fault in found if not (fault.doubt or fault.later))
    if site is None or faults:
        raise SiteFaults(where, faults)
    return site


def read_site(path: Path) -> SiteReading:
    """Everything that the text of a site file tells. Raises ConfigError (E-CFG-READ, E-CFG-ENCODING)."""
    text = _text(path)
    try:
        bear(text)
    except ValueError as error:
        return _is_empty((Fault((), "E-CFG-TOML", {"why": str(error), "meant": ""}),), "")
    try:
        tree, broken_lines, text_read = read_tree(text, LISTS)
    except RecursionError:
        why = {"why": words("W-TOML-DEEP"), "meant": ""}
        return _is_empty((Fault((), "E-CFG-TOML", why),), text)
    if not text_read:
        return _is_empty(broken_lines, text)
    if not tree and not broken_lines:
        return _is_empty((Fault((), "E-CFG-NOTHING", line=1, column=1),), text)
    tree, unmeant = without_control(tree)
    site, found = _judge(tree, partial=bool(broken_lines))
    found = (*found, *unmeant)
    found = tuple(one for one in found if not _named_there(one, tree, text, broken_lines))
    site = None if broken_lines else site
    told = with_positions((*broken_lines, *found), text_read)
    faults = tuple(fault for fault in told if not fault.doubt)
    doubts = tuple(fault for fault in told if fault.doubt)
    right = readable_section(SiteFile, tree, {fault.path for fault in faults})
    return SiteReading(site=site, faults=faults, doubts=doubts, text=text_read, tree=tree, seen=right)


def _is_empty(faults: tuple[Fault, ...], text: str) -> SiteReading:
    return SiteReading(site=None, faults=faults, doubts=(), text=text, tree={}, seen=readable_section(SiteFile, {}, ()))


def _text(path: Path) -> str:
    try:
        data = read_bounded(path)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        near = guess(path.name, _files_beside(path)) if isinstance(error, FileNotFoundError) else ""
        raise ConfigError("E-CFG-READ", shown(path), why=why + near) from error
    try:
        return decode_utf8(data)
    except ValueError as error:
        raise ConfigError("E-CFG-ENCODING", shown(path), why=str(error)) from error


def _files_beside(path: Path) -> list[str]:
    try:
        return sorted(one.name for one in path.parent.glob("*.toml"))[:100]
    except OSError:
        return []


def _judge(tree: dict[str, Any], *, partial: bool) -> tuple[SiteFile | None, tuple[Fault, ...]]:
    """The site and what its keys and the rules between them say; of a partial tree nothing is missed."""
    numbers = [broken_rule(tree, place, words("W-CFG-FINITE")) for place, _ in find_bad_numbers(tree)]
    infinite = {fault.path for fault in numbers}
    site, keys = key_faults(tree)
    found = [*numbers, *(one for one in keys if one.path not in infinite)]
    found += rule_faults(tree, {fault.path for fault in found})
    if partial:
        found = [one for one in found if not _is_absent(one, tree)]
    return (None if numbers else site), _each_once(found)


def _named_there(fault: Fault, tree: dict[str, Any], text: str, broken_lines: Sequence[Fault]) -> bool:
    """Whether a line that cannot be read says the very word that is not known: it may define it."""
    word, rows = value_at(tree, fault.path), text.split("\n")
    if not isinstance(word, str) or not word:
        return False
    form = re.compile(rf"\b{re.escape(word)}\b")
    return any(form.search(rows[one.line - 1]) for one in broken_lines if one.line)


def _is_absent(fault: Fault, tree: dict[str, Any]) -> bool:
    place = places_of(tree)
    return fault.path not in place and not fault.on_key


def places_of(tree: Any, path: tuple[str | int, ...] = ()) -> set[tuple[str | int, ...]]:
    """Every place of a tree that holds something."""
    found = {path}
    if isinstance(tree, dict | list):
        for key, part in tree.items() if isinstance(tree, dict) else enumerate(tree):
            found |= places_of(part, (*path, key))
    return found


def _each_once(faults: Sequence[Fault]) -> tuple[Fault, ...]:
    first: dict[tuple[object, ...], Fault] = {}
    for fault in faults:
        first.setdefault((fault.path, fault.doubt), fault)
    refused = {path for path, doubt in first if not doubt}
    return tuple(one for one in first.values() if not (one.doubt and one.path in refused))


def with_positions(faults: Sequence[Fault], text: str) -> tuple[Fault, ...]:
    """The faults in the order of the file, each with its line and column."""
    places = places_in(text)
    found = []
    for fault in faults:
        place = places.of(fault.path, key=fault.on_key) or START if fault.path and not fault.line else None
        found.append(replace(fault, line=place[0], column=place[1]) if place else fault)
    return tuple(sorted(found, key=lambda one: (one.line, one.column)))


def with_absolute_paths(site: SiteFile, folder: Path) -> SiteFile:
    """The same site with every path in a driver's settings taken from ``folder``."""
    controller = site.controller.model_copy(update={"settings": _settings(site.controller, "controller", folder)})
    instruments = tuple(
        one.model_copy(update={"settings": _settings(one, "instrument", folder)}) for one in site.instruments
    )
    return site.model_copy(update={"controller": controller, "instruments": instruments})


def _settings(section: Any, role: str, folder: Path) -> dict[str, Any]:
    spec = registry.known(role).get(section.driver)
    model = spec.load_settings() if spec is not None else None
    paths = model.paths() if model is not None else {}
    kept = dict(section.settings)
    for key, kind in paths.items():
        if isinstance(kept.get(key), str) and kept[key] and kind != "environment":
            kept[key] = str(folder / kept[key])
    return kept
