"""What no single key of a site file can tell: every rule between keys, in turn."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from drivers.errors import words
from drivers.local.names import shown
from gateway.config.axisfaults import axis_faults
from gateway.config.faults import Fault, called
from gateway.config.keyfaults import broken
from gateway.config.movesfaults import moves_faults
from gateway.config.paper.faults import paper_faults
from gateway.config.places import Path, held
from gateway.config.reaching import reach_faults
from gateway.config.sections import SiteFile
from gateway.config.seen import seen
from gateway.config.setupfaults import setup_faults
from gateway.config.workfaults import work_faults

# What the devices of a site are called by is one list, in which the control has this name.
TAKEN = "controller"


def rule_faults(tree: Mapping[str, Any], wrong: Collection[Path]) -> tuple[Fault, ...]:
    """Every rule between keys that the file breaks; ``wrong`` are places of keys that are refused already."""
    site = seen(SiteFile, tree, wrong)
    found = [fault for rule in _NOW for fault in rule(tree, site)]
    found += [replace(fault, later=True) for rule in _LATER for fault in rule(tree, site)]
    return tuple(fault for fault in found if fault.path not in wrong)


def _names(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    yield from _twice(tree, site.instruments, "name", "W-CFG-SAME-NAME")
    yield from _twice(tree, site.axes, "name", "W-CFG-SAME-NAME")
    yield from _twice(tree, site.axes, "letter", "W-CFG-SAME-LETTER")
    for instrument in site.instruments:
        if instrument.name == TAKEN:
            yield broken(tree, (*instrument.place, "name"), words("W-CFG-TAKEN"))


def _twice(tree: Mapping[str, Any], sections: Iterable[Any], key: str, code: str) -> Iterator[Fault]:
    """Each but the first of one name; upper and lower case make no difference in a file's name."""
    before: dict[str, int] = {}
    for number, section in enumerate(sections, start=1):
        name = getattr(section, key)
        if not isinstance(name, str) or not name:
            continue
        first = before.setdefault(name.lower(), number)
        if first != number:
            yield broken(tree, (*section.place, key), words(code, number=first))


def _escaped(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    r"""A text in which a backslash became something else: "D:\new\table.txt" holds a line end and a tabulator."""
    del site
    for path, text in texts(tree):
        if any(letter in _ESCAPED for letter in text):
            yield broken(tree, path, words("W-CFG-ESCAPED"))


def _slips(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Paths of the other system, assumed errors that no machine has, a broker's keys that do not fit each other."""
    store = getattr(site.site, "store", None)
    if os.sep == "/" and store is not None and _WINDOWS.search(str(store)):
        yield broken(tree, ("site", "store"), words("W-CFG-PATH-WINDOWS"), doubt=True)
    for key, unit in (("linear_um", "um"), ("angular_arcsec", "arcsec")):
        value = getattr(site.assumed, key, None)
        if isinstance(value, int | float) and not LEAST_ASSUMED <= value <= MOST_ASSUMED:
            code = "W-CFG-UNIT-ASSUMED" if value < LEAST_ASSUMED else "W-CFG-UNIT-ASSUMED-MUCH"
            yield broken(tree, ("assumed", key), words(code, unit=unit), doubt=True)
    mqtt = getattr(site.service, "mqtt", None)
    if hasattr(mqtt, "place"):
        yield from _broker(tree, mqtt)


def _broker(tree: Mapping[str, Any], mqtt: Any) -> Iterator[Fault]:
    """A name without a password, and the port of encrypted messages without what proves the server."""
    if mqtt.user and mqtt.password_file is None and not mqtt.password_env:
        yield broken(tree, (*mqtt.place, "user"), words("W-CFG-USER-ALONE"), doubt=True)
    if mqtt.port == MQTT_TLS and mqtt.ca is None and "ca" not in held(tree, mqtt.place):
        yield broken(tree, (*mqtt.place, "port"), words("W-CFG-TLS-PORT"), doubt=True)


def _nothing_measures(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Instruments that axes and set-ups name, in a file that has no section for any."""
    named = [one for one in (*(axis.measure for axis in site.axes), *site.setups) if getattr(one, "instrument", None)]
    if not site.instruments and "instruments" not in tree and named and not set(tree) - set(SiteFile.model_fields):
        fields = {"key": called(tree, (*named[0].place, "instrument")), "name": shown(named[0].instrument)}
        yield replace(broken(tree, ("instruments",), words("W-CFG-NO-INSTRUMENTS", **fields)), later=True)


def texts(tree: Any, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Every text of a tree with its place."""
    if isinstance(tree, str):
        yield path, tree
    elif isinstance(tree, Mapping | list):
        for key, part in tree.items() if isinstance(tree, Mapping) else enumerate(tree):
            yield from texts(part, (*path, key))


LEAST_ASSUMED, MOST_ASSUMED = 0.05, 500.0  # um or arcsec
MQTT_TLS = 8883
_WINDOWS = re.compile(r"\A[A-Za-z]:|\\")
_ESCAPED = "\a\b\t\n\f\r\v\x1b"
Rule = Callable[[Mapping[str, Any], Any], Iterable[Fault]]
_NOW: tuple[Rule, ...] = (
    _names,
    _escaped,
    _slips,
    _nothing_measures,
    axis_faults,
    setup_faults,
    moves_faults,
    paper_faults,
)
_LATER: tuple[Rule, ...] = (reach_faults, work_faults)
