"""A control on paper: what writes its programs, and what is known of it without asking it.

It opens no device and knows no push, so that a site file is checked without either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from drivers import registry
from drivers.errors import ConfigError
from drivers.programs import DayNumbers, Order, Origin, PaperMachine, ProgramText, SelfTested
from drivers.types.tables import CompensationTable
from gateway.config import AxisSection, SiteFile
from gateway.store.machine_books import SelfTestBook
from gateway.table.trial import triangle_for_axes
from gateway.workflow.run.folder import known_of, origin_of, store_of

ProgramKind = Literal["self-test", "measure", "load", "effect", "proof", "backup", "grind", "off", "dwell"]
SENT_KINDS: tuple[ProgramKind, ...] = ("self-test", "measure", "load", "effect", "proof", "backup", "grind", "off")
ALL_KINDS: tuple[ProgramKind, ...] = (*SENT_KINDS, "dwell")
"""All kinds; "effect" follows the load of a proposal; "dwell" is for capture programs of others, no run sends it."""
PAPER_NUMBERS = DayNumbers()


@dataclass(frozen=True, slots=True)
class PaperControl:
    """A site's control as its programs see it: what writes them, with which settings, and for whom.

    ``known`` is what its self-test kept, by axis; ``names`` are its axes in their order.
    """

    writer: Any
    settings: Mapping[str, Any]
    machine: PaperMachine
    origin: Origin
    where: str
    known: Mapping[str, SelfTested]
    names: tuple[str, ...]

    def write(self, order: Order) -> tuple[ProgramText, ...]:
        """The programs of one order, judged by the control's language; none of a road that sends none for it.

        Raises what writing and judging raise.
        """
        made = self.writer(order, self.settings, machine=self.machine, origin=self.origin, where=self.where)
        return tuple(made)


def paper_control(
    site: SiteFile,
    site_path: Path,
    wanted: tuple[ProgramKind, ...],
    tables: tuple[CompensationTable, ...] = (),
    numbers: DayNumbers = PAPER_NUMBERS,
) -> PaperControl:
    """What writes programs of these kinds for a site that loads ``tables``; without tables as small as its grids.

    Raises ConfigError (E-CFG-DRIVER, E-PROGRAM-NO-ROAD), StoreError, TableError (E-PUSH-TRIANGLE).
    """
    writer, settings = _writer(site, wanted)
    known = known_control(site, site_path)
    names, seen = _axis_names(site, site_path)
    machine = replace(_paper_machine(site, tables, known, names, numbers), seen=seen)
    return PaperControl(
        writer, settings, machine=machine, origin=origin_of(site), where=str(site_path), known=known, names=names
    )


def example_table(axis: AxisSection) -> tuple[CompensationTable, float]:
    """A sign proof's table on the axis' own grid, and where its peak is. Raises TableError (E-PUSH-TRIANGLE)."""
    facts, grid = axis.facts, axis.table
    return triangle_for_axes(facts, facts, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)


def known_control(site: SiteFile, site_path: Path) -> Mapping[str, SelfTested]:
    """The newest self-test of each axis of the site that kept what the control had reserved, by axis; all or none.

    Raises StoreError.
    """
    tests = SelfTestBook(store_of(site, site_path).root).all(site.controller.serial)
    kept = {(one.axis, one.encoder): one for one in tests if one.own_points is not None}
    found = {axis.name: kept[axis.name, axis.encoder] for axis in site.axes if (axis.name, axis.encoder) in kept}
    return found if len(found) == len(site.axes) else {}


def _axis_names(site: SiteFile, site_path: Path) -> tuple[tuple[str, ...], bool]:
    """The control's axes in their order, as it was seen or the site file states it; else, False, those of the site."""
    told = known_of(site, store_of(site, site_path).root).facts.get("axes", "").split()
    own = tuple(axis.name for axis in site.axes)
    return (tuple(told), True) if set(own) <= set(told) else (own, False)


def _paper_machine(
    site: SiteFile,
    tables: tuple[CompensationTable, ...],
    known: Mapping[str, SelfTested],
    names: tuple[str, ...],
    numbers: DayNumbers,
) -> PaperMachine:
    modulo = frozenset(axis.name for axis in site.axes if axis.modulo)
    if known:
        one = next(iter(known.values()))
        return PaperMachine(
            one.machine.axis_names,
            modulo,
            {name: test.own_points or 0 for name, test in known.items()},
            one.cross_points,
            places=site.moves.places,
            without=tuple(dict.fromkeys(word for test in known.values() for word in test.without)),
            file_kb=one.file_kb,
            numbers=numbers,
        )
    own = {axis.name: len(example_table(axis)[0].deviations) for axis in site.axes}
    cross = {table.index: len(table.deviations) for table in tables if table.kind == "cross"}
    asked = {table.output_axis: len(table.deviations) for table in tables if table.kind == "axis"}
    points = tuple(cross.get(table, 0) for table in range(max(cross, default=-1) + 1))
    held = {name: max(own[name], asked.get(name, 0)) for name in own}
    return PaperMachine(names, modulo, held, points, places=site.moves.places, numbers=numbers)


def _writer(site: SiteFile, wanted: tuple[ProgramKind, ...]) -> tuple[Any, Mapping[str, Any]]:
    """What writes programs for this road, or what goes over one that runs none, with the driver's settings.

    A program for a capture program of somebody else is carried by a person, so another road of the same maker will do.
    """
    driver, known = site.controller.driver, registry.known("paper")
    controls = registry.known("controller")
    if driver not in controls:
        raise registry.unknown_driver(driver, "controller", controls)
    if f"{driver}-paper" in known:
        return registry.load(f"{driver}-paper", "paper"), site.controller.settings
    if set(wanted) != {"dwell"} and f"{driver}-writes" in registry.known("writes"):
        return registry.load(f"{driver}-writes", "writes"), site.controller.settings
    maker = driver.partition("-")[0]
    others = [name for name in known if name.startswith(f"{maker}-")]
    if set(wanted) != {"dwell"} or not others:
        raise ConfigError("E-PROGRAM-NO-ROAD", site.site.name, driver=driver)
    return registry.load(others[0], "paper"), {}
