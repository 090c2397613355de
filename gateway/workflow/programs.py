"""Every program that a site would send, written without a control: to be read and signed before the first day.

What only the control knows is taken as small as the work allows: as many points as the tables ask
for, and no tables of others. Numbers of runs and transactions are none that was ever given.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from drivers import registry
from drivers.errors import ConfigError
from drivers.programs import Order, PaperMachine, ProgramText, SelfTest
from drivers.terms import spoken
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from gateway.capture.targets import jog_plan, jog_start, measuring_plan, plan_of, targets_of, with_checks
from gateway.config import AxisSection, SiteFile
from gateway.domain.proposals import Proposal
from gateway.push.proofs.switching import TIMES
from gateway.push.trials import triangle_of
from gateway.tooth import SetupValues
from gateway.walk import Patience, question
from gateway.workflow.axes.measure import check_stops
from gateway.workflow.bench import origin_of
from gateway.workflow.dwelling import DwellWish, dwell_plans
from gateway.workflow.errors21.setups import Planned, planned
from gateway.workflow.part.grinding import gear_of_site, grind_plan

What = Literal["self-test", "measure", "load", "proof", "backup", "grind", "off", "dwell"]
EVERY: tuple[What, ...] = ("self-test", "measure", "load", "proof", "backup", "grind", "off")
KNOWN: tuple[What, ...] = (*EVERY, "dwell")
"""All kinds; "dwell" is for capture programs of others, and no run of ours sends it."""
NUMBER = 999_999


@dataclass(frozen=True, slots=True)
class Written:
    """One program: what it is for, a name of its own among the others, and its text."""

    what: What
    name: str
    program: ProgramText


def programs(
    site: SiteFile,
    site_path: Path,
    wanted: tuple[What, ...] = EVERY,
    proposal: Proposal | None = None,
    *,
    dwell: DwellWish | None = None,
) -> tuple[Written, ...]:
    """Programs of these kinds in the order in which a run sends them; ``load`` from ``proposal`` or an example table.

    Raises ConfigError (E-PROGRAM-NO-ROAD) for a road that runs no programs, and what writing and judging raise.
    """
    write, settings = _writer(site, wanted)
    tables = _loaded(site, proposal)
    machine, origin = _machine(site, tables), origin_of(site)
    found = []
    for what in wanted:
        for name, order in _orders(site, site_path, what, tables) if what != "dwell" else _dwelling(site, dwell):
            made = write(order, settings, machine=machine, origin=origin, where=str(site_path))
            found += [Written(what, f"{what}-{name}-{one.file_name}", one) for one in made]
    return tuple(found)


def kept(files: Mapping[str, str], folder: Path, *, force: bool = False) -> None:
    """Write texts by name. Raises ConfigError (E-PROGRAM-THERE), before the first is written, unless ``force``."""
    there = [name for name in files if (folder / name).exists()]
    if there and not force:
        raise ConfigError("E-PROGRAM-THERE", str(folder), name=there[0], count=len(there))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii", newline="\n")
    except OSError as error:
        raise ConfigError("E-PROGRAM-FOLDER", str(folder), why=str(error)) from error


def _loaded(site: SiteFile, proposal: Proposal | None) -> tuple[CompensationTable, ...]:
    """The tables of a proposal; without one an example for each axis, of the size that its own table will have."""
    if proposal is not None:
        return tuple(change.new for change in proposal.changes if not change.skipped)
    return tuple(_triangle(axis)[0] for axis in site.axes)


def _triangle(axis: AxisSection) -> tuple[CompensationTable, float]:
    facts, grid = axis.facts, axis.table
    return triangle_of(facts, facts, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)


def _machine(site: SiteFile, tables: tuple[CompensationTable, ...]) -> PaperMachine:
    own = {axis.name: len(_triangle(axis)[0].deviations) for axis in site.axes}
    cross = {table.index: len(table.deviations) for table in tables if table.kind == "cross"}
    asked = {table.output_axis: len(table.deviations) for table in tables if table.kind == "axis"}
    modulo = frozenset(axis.name for axis in site.axes if axis.modulo)
    points = tuple(cross.get(number, 0) for number in range(max(cross, default=-1) + 1))
    names = tuple(axis.name for axis in site.axes)
    held = {name: max(own[name], asked.get(name, 0)) for name in names}
    return PaperMachine(names, modulo, held, points, places=site.moves.places)


def _orders(
    site: SiteFile, site_path: Path, what: What, tables: tuple[CompensationTable, ...]
) -> Iterator[tuple[str, Order]]:
    if what == "grind":
        if site.work is not None:
            yield "part", grind_plan(site, gear_of_site(site, site_path), SetupValues())
    elif what == "load":
        yield from (_load(site, table) for table in tables)
    else:
        axes = site.axes if what != "measure" or not site.setups else ()
        for axis in axes:
            yield from _of_axis(axis, what)
        if what == "measure" and site.setups:
            yield from (order for one in planned(site) for order in _of_setup(site, one))


def _writer(site: SiteFile, wanted: tuple[What, ...]) -> tuple[Any, Mapping[str, Any]]:
    """What writes programs for this road, with the driver's settings.

    A program for a capture program of somebody else is carried by a person, so another road of the same maker will do.
    """
    driver, known = site.controller.driver, registry.known("paper")
    if f"{driver}-paper" in known:
        return registry.load(f"{driver}-paper", "paper"), site.controller.settings
    maker = driver.partition("-")[0]
    others = [name for name in known if name.startswith(f"{maker}-")]
    if set(wanted) != {"dwell"} or not others:
        raise ConfigError("E-PROGRAM-NO-ROAD", site.site.name, driver=driver)
    return registry.load(others[0], "paper"), {}


def _dwelling(site: SiteFile, wish: DwellWish | None) -> Iterator[tuple[str, Order]]:
    return ((axis.letter, plan) for axis, plan in dwell_plans(site, wish or DwellWish()))


def _of_axis(axis: AxisSection, what: What) -> Iterator[tuple[str, Order]]:
    if what == "measure":
        if axis.measure.file is None:
            yield from _measured(axis, f"{axis.letter}-{axis.measure.component}", axis.measure.jog)
        else:
            yield from _of_axis(axis, "backup")
    elif what == "backup":
        yield axis.letter, question(axis.facts, Patience(0.0, 0.0))
    elif what == "self-test":
        yield axis.letter, SelfTest(axis.name, axis.encoder, axis.encoder_said)
    elif what == "proof":
        yield from _proof(axis)
    else:
        yield axis.letter, DisableOrder(NUMBER, "axis", axis.name, axis.encoder)


def _measured(axis: AxisSection, name: str, jog: float, between: bool = True) -> Iterator[tuple[str, Order]]:
    """The move that proves the mounting, then every target, with check stops where an axis is positioned."""
    setup = f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"
    yield f"{name}-jog", jog_plan(axis, jog_start(axis, jog), jog, setup)
    places, checks = with_checks(targets_of(axis), check_stops(axis, "before") if between else None)
    yield name, measuring_plan(axis, places, "", name=f"TFMEAS{axis.letter}", checks=checks)


def _of_setup(site: SiteFile, one: Planned) -> Iterator[tuple[str, Order]]:
    if one.setup.source != "live":
        return
    for name, place in sorted(one.setup.park.items()):
        axis = next(axis for axis in site.axes if axis.name == name)
        parked = plan_of(axis, (Stop(place, 1),), "", name=f"TFPARK{axis.letter}", dwell_s=0.1, save=False)
        yield f"{one.key}-park-{axis.letter}", parked
    jog = one.axis.measure.jog if one.positioning else one.jog
    yield from _measured(one.axis, one.key, jog, between=one.positioning)


def _load(site: SiteFile, table: CompensationTable) -> tuple[str, Order]:
    moved = next(axis for axis in site.axes if axis.name == table.input_axis)
    identity = MachineIdentity(site.controller.serial, "", tuple(axis.name for axis in site.axes))
    proof = SignProof(identity, table.kind, output_axis=table.output_axis, slope=1.0, slope_u=0.01, sign=1, date_utc="")
    order = _order(moved, table, "table", proof)
    key = spoken().key(table.kind)
    return f"{key}-{table.output_axis}-{table.input_axis}", (order,)


def _order(
    moved: AxisSection,
    table: CompensationTable,
    purpose: Literal["table", "sign-proof"],
    proof: SignProof | None = None,
) -> PushOrder:
    return PushOrder(
        NUMBER,
        table,
        letter=moved.letter,
        rotary=moved.kind == "rotary",
        enable=purpose == "table",
        agreeing_position=moved.reference,
        purpose=purpose,
        proof=proof,
    )


def _proof(axis: AxisSection) -> Iterator[tuple[str, Order]]:
    """The triangle table, the stops that switch it, and the old table back."""
    table, peak = _triangle(axis)
    order = _order(axis, table, "sign-proof")
    yield f"{axis.letter}-triangle", (order,)
    stops = tuple(
        Stop(peak, 1, repetition=number // 2, label=number, switch=bool(number % 2)) for number in range(2 * TIMES + 1)
    )
    setup = f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"
    switching: StopPlan = plan_of(axis, stops, setup, name=f"TFSIGN{axis.letter}", dwell_s=axis.measure.dwell_s)
    yield f"{axis.letter}-switching", switching
    nothing = replace(table, deviations=tuple(0.0 for _ in table.deviations))
    yield f"{axis.letter}-restore", (replace(order, table=nothing, enable=False, purpose="restore"),)
