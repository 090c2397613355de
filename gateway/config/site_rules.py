"""Rules between the keys of a whole site file, in turn; those of grinding and of the register and tolerances too."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from drivers import registry
from drivers.errors import words
from drivers.local.names import shown
from gateway.config.axis_rules import axis_faults, moves_faults, setup_faults
from gateway.config.connections import reach_faults
from gateway.config.faults import Fault, Path, place_name, value_at
from gateway.config.model_faults import broken_rule, readable_section
from gateway.config.rules import GEAR_MACHINE, all_named, is_pair, no_such
from gateway.config.sections import SiteFile
from gateway.errors import ModelError
from gateway.evaluate.standards.conformity import FIGURES
from gateway.evaluate.standards.registry import standard

# What the work section says wrong of the axes that grind, of wheel and dresser and of the gear inspection machine.

R_PARAMETER = re.compile(r"R(\d+)")
_LIKE_R = re.compile(r"[Rr][\s.,=_-]*\d+([.,]\d+)?")
_ROLES = {"infeed": "linear", "stroke": "linear", "index": "rotary"}


def work_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the work section says wrong."""
    work = site.work
    if not hasattr(work, "place"):
        return
    yield from _axes(tree, site, work)
    if is_pair(work.wheel_travel) and work.wheel_travel[0] >= work.wheel_travel[1]:
        yield broken_rule(tree, (*work.place, "wheel_travel"), words("W-CFG-TRAVEL"))
    if isinstance(work.rough_mm, list):
        for number, value in enumerate(work.rough_mm):
            if value <= 0:
                yield broken_rule(tree, (*work.place, "rough_mm", number), words("W-CFG-ROUGH"))
            elif number and value >= work.rough_mm[number - 1]:
                yield broken_rule(tree, (*work.place, "rough_mm", number), words("W-CFG-ROUGH-FALLS"))
    yield from _dresser(tree, site, work)
    yield from _wheel(tree, site, work)
    yield from _inspector(tree, site, work)


def _dresser(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    """The dresser has an axis of its own, and programs call it by a letter that no other axis has."""
    if not isinstance(work.dresser, str) or not work.dresser:
        return
    taken = {name: role for role in _ROLES for name in _both(site, getattr(work, role))}
    if work.dresser in taken:
        yield broken_rule(tree, (*work.place, "dresser"), words("W-CFG-ROLE-TAKEN", role=taken[work.dresser]))
        return
    for axis in site.axes:
        if axis.letter is not None and axis.letter == work.dresser_letter and axis.name != work.dresser:
            place = "dresser_letter" if "dresser_letter" in value_at(tree, work.place) else "dresser"
            yield broken_rule(
                tree, (*work.place, place), words("W-CFG-DRESSER-LETTER", letter=axis.letter, axis=axis.name)
            )


def _wheel(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    """What places the wheel along its axis: no axis that has a role already, and never the dresser's."""
    if not isinstance(work.wheel_place, str) or not work.wheel_place or R_PARAMETER.fullmatch(work.wheel_place):
        return
    taken = {name: role for role in _ROLES for name in _both(site, getattr(work, role))}
    dressers = {work.dresser, *_both(site, work.dresser)} - {""}
    known = _both(site, work.wheel_place)
    if work.wheel_place in dressers:
        yield broken_rule(tree, (*work.place, "wheel_place"), words("W-CFG-WHEEL-DRESSER", axis=work.wheel_place))
    elif work.wheel_place in taken:
        yield broken_rule(tree, (*work.place, "wheel_place"), words("W-CFG-ROLE-TAKEN", role=taken[work.wheel_place]))
    elif not known and (meant := _meant(site, work.wheel_place)):
        said = {"given": work.wheel_place, "meant": meant}
        yield broken_rule(tree, (*work.place, "wheel_place"), words("W-CFG-WHEEL-SPELLED", **said))
    elif not known:
        letters = {axis.letter: axis.name for axis in site.axes if isinstance(axis.letter, str)}
        if isinstance(work.dresser, str) and work.dresser:
            letters.setdefault(work.dresser_letter, work.dresser)
        if work.wheel_letter in letters:
            place = "wheel_letter" if "wheel_letter" in value_at(tree, work.place) else "wheel_place"
            said = {"letter": work.wheel_letter, "axis": letters[work.wheel_letter]}
            yield broken_rule(tree, (*work.place, place), words("W-CFG-WHEEL-LETTER", **said))


def _meant(site: Any, given: str) -> str:
    """What a name that is neither axis nor R parameter is spelled like; "" for an axis that is not in the site file.

    Taken for such an axis, "r200" would make a program that moves it.
    """
    names = (name for axis in site.axes for name in (axis.name, axis.letter) if isinstance(name, str))
    alike = next((name for name in names if name.casefold() == given.strip().casefold()), "")
    number = re.search(r"\d+", given)
    return alike or (f"R{number[0]}" if _LIKE_R.fullmatch(given) and number else "")


def _both(site: Any, wanted: Any) -> tuple[str, ...]:
    """Name and letter of the axis that is meant by either."""
    return next(((axis.name, axis.letter) for axis in site.axes if wanted in (axis.name, axis.letter)), ())


def _axes(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    kinds = {name: axis.kind for axis in site.axes for name in (axis.letter, axis.name) if isinstance(name, str)}
    names = {name: axis.name for axis in site.axes for name in (axis.letter, axis.name) if isinstance(name, str)}
    taken: dict[str, str] = {}
    # An axis whose name or letter is refused may be the one that is meant.
    whole = all_named(site.axes) and all(isinstance(axis.letter, str) for axis in site.axes)
    for role, kind in _ROLES.items():
        wanted = getattr(work, role)
        if (
            whole
            and isinstance(wanted, str)
            and wanted not in kinds
            and value_at(tree, (*work.place, role)) is not None
        ):
            yield no_such(tree, (*work.place, role), "axis", kinds)
        elif isinstance(wanted, str) and kinds.get(wanted) not in (kind, None):
            yield broken_rule(tree, (*work.place, role), words("W-CFG-ROLE", kind=kind))
        elif isinstance(wanted, str) and names.get(wanted) in taken:
            yield broken_rule(tree, (*work.place, role), words("W-CFG-ROLE-TAKEN", role=taken[names[wanted]]))
        if isinstance(wanted, str) and wanted in names:
            taken.setdefault(names[wanted], role)


def _inspector(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    drivers = {one.name: one.driver for one in site.instruments if isinstance(one.name, str)}
    machines = registry.known(GEAR_MACHINE)
    if not isinstance(work.inspector, str) or not work.inspector:
        return
    if work.inspector not in drivers:
        yield no_such(tree, (*work.place, "inspector"), "instrument", [n for n in drivers if drivers[n] in machines])
    elif drivers[work.inspector] not in machines and drivers[work.inspector] in registry.known("instrument"):
        yield broken_rule(tree, (*work.place, "inspector"), words("W-CFG-NO-GEAR-MACHINE"))


# What the register of equipment and the tolerances say wrong of axes, instruments, standards and figures.

LEAST_LIMIT, MOST_LIMIT = 0.05, 1000.0
OF_CLASS = ("module_mm", "diameter_mm", "width_mm")


def paper_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Names of nothing, standards that nobody knows, figures that a standard has not, dates in the wrong order."""
    instruments = [one.name for one in site.instruments if isinstance(one.name, str)]
    before: dict[tuple[str, str], int] = {}
    for number, one in enumerate(site.equipment, start=1):
        first = before.setdefault((str(one.name), str(one.serial)), number)
        if first != number and isinstance(one.name, str):
            yield broken_rule(tree, (*one.place, "name"), words("W-CFG-SAME-EQUIPMENT", number=first), doubt=True)
        if isinstance(one.instrument, str) and one.instrument and one.instrument not in instruments:
            yield no_such(tree, (*one.place, "instrument"), "instrument", instruments)
        if one.calibrated and one.due and str(one.due) <= str(one.calibrated):
            yield broken_rule(tree, (*one.place, "due"), words("W-CFG-DUE", calibrated=one.calibrated))
    axes, limits = [axis.name for axis in site.axes if isinstance(axis.name, str)], set[tuple[str, str, str]]()
    for one in site.tolerances:
        if isinstance(one.axis, str) and one.axis not in axes:
            yield no_such(tree, (*one.place, "axis"), "axis", axes)
        yield from _figure_faults(tree, one)
        yield from _limit_faults(tree, one, limits)
    yield from _gear_faults(tree, site.gear_tolerance)
    yield from _side_faults(tree, site.machine)


def _side_faults(tree: Mapping[str, Any], machine: Any) -> Iterator[Fault]:
    """An axis carries the work or the tool, once."""
    seen: list[Any] = []
    for key in ("work_side", "tool_side"):
        for number, letter in enumerate(getattr(machine, key, None) or ()):
            if letter in seen:
                yield broken_rule(tree, ("machine", key, number), words("W-CFG-SIDE-TWICE"))
            seen.append(letter)


def _limit_faults(tree: Mapping[str, Any], one: Any, before: set[tuple[str, str, str]]) -> Iterator[Fault]:
    """No limit at all, one that no machine keeps, or the same figure of one axis twice."""
    if not isinstance(one.limits, Mapping):
        return
    if not one.limits:
        yield broken_rule(tree, (*one.place, "limits"), words("W-CFG-LIMITS-NONE"))
    for name, limit in one.limits.items():
        path, key = (*one.place, "limits", name), (str(one.axis), str(one.standard), name)
        if isinstance(limit, int | float) and 0 < limit < LEAST_LIMIT:
            yield broken_rule(tree, path, words("W-CFG-UNIT-LIMIT"), doubt=True)
        if isinstance(limit, int | float) and limit > MOST_LIMIT:
            yield broken_rule(tree, path, words("W-CFG-UNIT-LIMIT-MUCH"), doubt=True)
        if key in before:
            yield broken_rule(tree, path, words("W-CFG-LIMIT-TWICE"))
        before.add(key)


def _figure_faults(tree: Mapping[str, Any], one: Any) -> Iterator[Fault]:
    if not isinstance(one.standard, str):
        return
    try:
        known = standard(one.standard).parameters
    except ModelError as error:
        yield broken_rule(tree, (*one.place, "standard"), words("W-CFG-STANDARD", known=error.fields["known"]))
        return
    for name in one.limits if isinstance(one.limits, Mapping) else ():
        if name not in known:
            yield no_such(tree, (*one.place, "limits", name), "figure", known, by_key=True)


def _gear_faults(tree: Mapping[str, Any], one: Any) -> Iterator[Fault]:
    if not hasattr(one, "place"):
        return
    for name, limit in one.limits.items() if isinstance(one.limits, Mapping) else ():
        if name not in FIGURES:
            yield no_such(tree, (*one.place, "limits", name), "figure", FIGURES, by_key=True)
        elif isinstance(limit, int | float) and 0 < limit < LEAST_LIMIT:
            yield broken_rule(tree, (*one.place, "limits", name), words("W-CFG-UNIT-LIMIT"), doubt=True)
    missing = [key for key in OF_CLASS if getattr(one, key) is None]
    if one.grade is not None and missing:
        yield broken_rule(tree, (*one.place, "grade"), words("W-CFG-CLASS", missing=", ".join(missing)))
    if "grade" not in value_at(tree, one.place) and one.grade is None and not one.limits:
        yield broken_rule(tree, one.place, words("W-CFG-NO-LIMIT"))


# What no single key of a site file can tell: every rule between keys, in turn.

# What the devices of a site are called by is one list, in which the control has this name.
TAKEN = "controller"


def rule_faults(tree: Mapping[str, Any], wrong: Collection[Path]) -> tuple[Fault, ...]:
    """Every rule between keys that the file breaks; ``wrong`` are places of keys that are refused already."""
    site = readable_section(SiteFile, tree, wrong)
    found = [fault for rule in _NOW for fault in rule(tree, site)]
    found += [replace(fault, later=True) for rule in _LATER for fault in rule(tree, site)]
    return tuple(fault for fault in found if fault.path not in wrong)


def _names(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    yield from _duplicates(tree, site.instruments, "name", "W-CFG-SAME-NAME")
    yield from _duplicates(tree, site.axes, "name", "W-CFG-SAME-NAME")
    yield from _duplicates(tree, site.axes, "letter", "W-CFG-SAME-LETTER")
    for instrument in site.instruments:
        if instrument.name == TAKEN:
            yield broken_rule(tree, (*instrument.place, "name"), words("W-CFG-TAKEN"))


def _duplicates(tree: Mapping[str, Any], sections: Iterable[Any], key: str, code: str) -> Iterator[Fault]:
    """Each but the first of one name; upper and lower case make no difference in a file's name."""
    before: dict[str, int] = {}
    for number, section in enumerate(sections, start=1):
        name = getattr(section, key)
        if not isinstance(name, str) or not name:
            continue
        first = before.setdefault(name.lower(), number)
        if first != number:
            yield broken_rule(tree, (*section.place, key), words(code, number=first))


def _escaped_texts(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    r"""A text in which a backslash became something else: "D:\new\table.txt" holds a line end and a tabulator."""
    del site
    for path, text in texts(tree):
        if any(letter in _ESCAPED for letter in text):
            yield broken_rule(tree, path, words("W-CFG-ESCAPED"))


def _slips(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Paths of the other system, assumed errors that no machine has, a broker's keys that do not fit each other."""
    store = getattr(site.site, "store", None)
    if os.sep == "/" and store is not None and _WINDOWS.search(str(store)):
        yield broken_rule(tree, ("site", "store"), words("W-CFG-PATH-WINDOWS"), doubt=True)
    for key, unit in (("linear_um", "um"), ("angular_arcsec", "arcsec")):
        value = getattr(site.assumed, key, None)
        if isinstance(value, int | float) and not LEAST_ASSUMED <= value <= MOST_ASSUMED:
            code = "W-CFG-UNIT-ASSUMED" if value < LEAST_ASSUMED else "W-CFG-UNIT-ASSUMED-MUCH"
            yield broken_rule(tree, ("assumed", key), words(code, unit=unit), doubt=True)
    mqtt = getattr(site.service, "mqtt", None)
    if hasattr(mqtt, "place"):
        yield from _broker(tree, mqtt)


def _broker(tree: Mapping[str, Any], mqtt: Any) -> Iterator[Fault]:
    """A name without a password, and the port of encrypted messages without what proves the server."""
    if mqtt.user and mqtt.password_file is None and not mqtt.password_env:
        yield broken_rule(tree, (*mqtt.place, "user"), words("W-CFG-USER-ALONE"), doubt=True)
    if mqtt.port == MQTT_TLS and mqtt.ca is None and "ca" not in value_at(tree, mqtt.place):
        yield broken_rule(tree, (*mqtt.place, "port"), words("W-CFG-TLS-PORT"), doubt=True)


def _nothing_measures(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Instruments that axes and set-ups name, in a file that has no section for any."""
    named = [one for one in (*(axis.measure for axis in site.axes), *site.setups) if getattr(one, "instrument", None)]
    if not site.instruments and "instruments" not in tree and named and not set(tree) - set(SiteFile.model_fields):
        fields = {"key": place_name(tree, (*named[0].place, "instrument")), "name": shown(named[0].instrument)}
        yield replace(broken_rule(tree, ("instruments",), words("W-CFG-NO-INSTRUMENTS", **fields)), later=True)


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
    _escaped_texts,
    _slips,
    _nothing_measures,
    axis_faults,
    setup_faults,
    moves_faults,
    paper_faults,
)
_LATER: tuple[Rule, ...] = (reach_faults, work_faults)
