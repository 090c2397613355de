"""What the work section says wrong of the axes that grind, of wheel and dresser and of the gear inspection machine."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from drivers import registry
from drivers.errors import words
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.rules import GEAR_MACHINE, all_named, is_pair, no_such

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
        yield broken(tree, (*work.place, "wheel_travel"), words("W-CFG-TRAVEL"))
    if isinstance(work.rough_mm, list):
        for number, value in enumerate(work.rough_mm):
            if value <= 0:
                yield broken(tree, (*work.place, "rough_mm", number), words("W-CFG-ROUGH"))
            elif number and value >= work.rough_mm[number - 1]:
                yield broken(tree, (*work.place, "rough_mm", number), words("W-CFG-ROUGH-FALLS"))
    yield from _dresser(tree, site, work)
    yield from _wheel(tree, site, work)
    yield from _inspector(tree, site, work)


def _dresser(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    """The dresser has an axis of its own, and programs call it by a letter that no other axis has."""
    if not isinstance(work.dresser, str) or not work.dresser:
        return
    taken = {name: role for role in _ROLES for name in _both(site, getattr(work, role))}
    if work.dresser in taken:
        yield broken(tree, (*work.place, "dresser"), words("W-CFG-ROLE-TAKEN", role=taken[work.dresser]))
        return
    for axis in site.axes:
        if axis.letter is not None and axis.letter == work.dresser_letter and axis.name != work.dresser:
            place = "dresser_letter" if "dresser_letter" in held(tree, work.place) else "dresser"
            yield broken(tree, (*work.place, place), words("W-CFG-DRESSER-LETTER", letter=axis.letter, axis=axis.name))


def _wheel(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    """What places the wheel along its axis: no axis that has a role already, and never the dresser's."""
    if not isinstance(work.wheel_place, str) or not work.wheel_place or R_PARAMETER.fullmatch(work.wheel_place):
        return
    taken = {name: role for role in _ROLES for name in _both(site, getattr(work, role))}
    dressers = {work.dresser, *_both(site, work.dresser)} - {""}
    known = _both(site, work.wheel_place)
    if work.wheel_place in dressers:
        yield broken(tree, (*work.place, "wheel_place"), words("W-CFG-WHEEL-DRESSER", axis=work.wheel_place))
    elif work.wheel_place in taken:
        yield broken(tree, (*work.place, "wheel_place"), words("W-CFG-ROLE-TAKEN", role=taken[work.wheel_place]))
    elif not known and (meant := _meant(site, work.wheel_place)):
        said = {"given": work.wheel_place, "meant": meant}
        yield broken(tree, (*work.place, "wheel_place"), words("W-CFG-WHEEL-SPELLED", **said))
    elif not known:
        letters = {axis.letter: axis.name for axis in site.axes if isinstance(axis.letter, str)}
        if isinstance(work.dresser, str) and work.dresser:
            letters.setdefault(work.dresser_letter, work.dresser)
        if work.wheel_letter in letters:
            place = "wheel_letter" if "wheel_letter" in held(tree, work.place) else "wheel_place"
            said = {"letter": work.wheel_letter, "axis": letters[work.wheel_letter]}
            yield broken(tree, (*work.place, place), words("W-CFG-WHEEL-LETTER", **said))


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
        if whole and isinstance(wanted, str) and wanted not in kinds and held(tree, (*work.place, role)) is not None:
            yield no_such(tree, (*work.place, role), "axis", kinds)
        elif isinstance(wanted, str) and kinds.get(wanted) not in (kind, None):
            yield broken(tree, (*work.place, role), words("W-CFG-ROLE", kind=kind))
        elif isinstance(wanted, str) and names.get(wanted) in taken:
            yield broken(tree, (*work.place, role), words("W-CFG-ROLE-TAKEN", role=taken[names[wanted]]))
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
        yield broken(tree, (*work.place, "inspector"), words("W-CFG-NO-GEAR-MACHINE"))
