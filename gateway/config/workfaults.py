"""What the work section says wrong of the axes that grind, of the dresser and of the gear inspection machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drivers import registry
from drivers.errors import words
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.rules import GEAR_MACHINE, is_pair, no_such

_ROLES = {"infeed": "linear", "stroke": "linear", "index": "rotary"}


def work_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the work section says wrong."""
    work = site.work
    if not hasattr(work, "place"):
        return
    yield from _axes(tree, site, work)
    if is_pair(work.dresser_travel) and work.dresser_travel[0] >= work.dresser_travel[1]:
        yield broken(tree, (*work.place, "dresser_travel"), words("W-CFG-TRAVEL"))
    if isinstance(work.rough_mm, list):
        for number, value in enumerate(work.rough_mm):
            if value <= 0:
                yield broken(tree, (*work.place, "rough_mm", number), words("W-CFG-ROUGH"))
    yield from _inspector(tree, site, work)


def _axes(tree: Mapping[str, Any], site: Any, work: Any) -> Iterator[Fault]:
    kinds = {name: axis.kind for axis in site.axes for name in (axis.letter, axis.name) if isinstance(name, str)}
    names = {name: axis.name for axis in site.axes for name in (axis.letter, axis.name) if isinstance(name, str)}
    taken: dict[str, str] = {}
    for role, kind in _ROLES.items():
        wanted = getattr(work, role)
        if isinstance(wanted, str) and wanted not in kinds and held(tree, (*work.place, role)) is not None:
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
