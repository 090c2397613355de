"""Every program that a site would send, written without a control: to be read and signed before the first day.

They are the programs of the site's next commands: what only the control knows (its axes, what it has reserved, words
that it does not take) is what its self-test kept. Before a self-test it is taken as small as the work allows: as many
points as the tables ask for, and no tables of others. The number is none that was ever given.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from drivers import registry
from drivers.errors import ConfigError
from drivers.programs import Order, PaperMachine, ProgramText, SelfTest, SelfTested, Visits
from drivers.types.abilities import Capabilities
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushOrder, SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from gateway.capture.targets import plan_of
from gateway.config import AxisSection, SiteFile
from gateway.domain.proposals import Proposal
from gateway.push.places import place_of_all
from gateway.push.proofs.switching import TIMES
from gateway.push.trials import triangle_of
from gateway.store.proofs import Proofs
from gateway.store.selftests import SelfTestBook
from gateway.tooth import SetupValues
from gateway.walk import Patience, question
from gateway.workflow.axes.measure import plans_of_axis
from gateway.workflow.bench import origin_of
from gateway.workflow.dwelling import DwellWish, dwell_plans
from gateway.workflow.errors21.setupcapture import coming
from gateway.workflow.errors21.setups import planned
from gateway.workflow.part.grinding import gear_of_site, grind_plan
from gateway.workflow.runsite import store_of

What = Literal["self-test", "measure", "load", "proof", "backup", "grind", "off", "dwell"]
EVERY: tuple[What, ...] = ("self-test", "measure", "load", "proof", "backup", "grind", "off")
KNOWN: tuple[What, ...] = (*EVERY, "dwell")
"""All kinds; "dwell" is for capture programs of others, and no run of ours sends it."""
NUMBER = 999_999
ON_PAPER = Capabilities(stops=True, tables=(), switched="at-stop", marker=True, consent="start", together=True)
"""What a control can do whose programs are written here: they switch tables at a stop, all of a layer together."""


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
    number: int = NUMBER,
) -> tuple[Written, ...]:
    """Programs of these kinds in the order in which a run sends them; ``load`` from ``proposal`` or an example table.

    With what the control's self-test kept of it they are what is sent, byte for byte, ``number`` apart: each program
    gets one of its own when it is sent. Axes are taken to stand in their safe places then, as commands ask for.

    Raises ConfigError (E-PROGRAM-NO-ROAD) for a road that runs no programs, and what writing and judging raise.
    """
    write, settings = _writer(site, wanted)
    tables = _loaded(site, proposal)
    known = known_control(site, site_path)
    machine, origin = _machine(site, tables, known, number), origin_of(site)
    made_for = _For(site, site_path, tables, proposal, known, number)
    found = []
    for what in wanted:
        for name, order in _orders(made_for, what) if what != "dwell" else _dwelling(site, dwell):
            made = write(order, settings, machine=machine, origin=origin, where=str(site_path))
            names = [one.file_name for one in made]
            for place, one in enumerate(made):
                again = names[:place].count(one.file_name)
                found.append(Written(what, f"{what}-{name}{f'-{again + 1}' if again else ''}-{one.file_name}", one))
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


def known_control(site: SiteFile, site_path: Path) -> Mapping[str, SelfTested]:
    """The newest self-test of each axis of the site that kept what the control had reserved, by axis; all or none.

    Raises StoreError.
    """
    tests = SelfTestBook(store_of(site, site_path).root).all(site.controller.serial)
    kept = {(one.axis, one.encoder): one for one in tests if one.own_points is not None}
    found = {axis.name: kept[axis.name, axis.encoder] for axis in site.axes if (axis.name, axis.encoder) in kept}
    return found if len(found) == len(site.axes) else {}


@dataclass(frozen=True, slots=True)
class _For:
    """What programs are written for: a site, the tables to be loaded, and what is known of its control."""

    site: SiteFile
    path: Path
    tables: tuple[CompensationTable, ...]
    proposal: Proposal | None
    known: Mapping[str, SelfTested]
    number: int

    @property
    def machine(self) -> MachineIdentity:
        """The control's own fingerprint where a self-test kept it."""
        if self.known:
            return next(iter(self.known.values())).machine
        return MachineIdentity(self.site.controller.serial, "", tuple(axis.name for axis in self.site.axes))


def _machine(
    site: SiteFile, tables: tuple[CompensationTable, ...], known: Mapping[str, SelfTested], number: int
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
            number=number,
        )
    own = {axis.name: len(_triangle(axis)[0].deviations) for axis in site.axes}
    cross = {table.index: len(table.deviations) for table in tables if table.kind == "cross"}
    asked = {table.output_axis: len(table.deviations) for table in tables if table.kind == "axis"}
    points = tuple(cross.get(table, 0) for table in range(max(cross, default=-1) + 1))
    names = tuple(axis.name for axis in site.axes)
    held = {name: max(own[name], asked.get(name, 0)) for name in names}
    return PaperMachine(names, modulo, held, points, places=site.moves.places, number=number)


def _orders(made: _For, what: What) -> Iterator[tuple[str, Order]]:
    site = made.site
    if what == "grind":
        if site.work is not None:
            yield "part", grind_plan(site, gear_of_site(site, made.path), SetupValues())
    elif what == "load":
        yield from _loads(made)
    elif what == "measure":
        yield from _measured(site)
    else:
        for axis in site.axes:
            yield from _of_axis(made, axis, what)


def _measured(site: SiteFile) -> Iterator[tuple[str, Order]]:
    """What a run of the axes sends, and what measuring the errors sends: plans in one program, as they are foreseen."""
    live = [axis for axis in site.axes if axis.measure.file is None]
    plans = tuple(plan for axis in live for plan in plans_of_axis(axis, "before"))
    if plans:
        yield "axes", Visits(plans)
    for axis in site.axes:
        if axis.measure.file is not None:
            yield f"tables-{axis.letter}", question(axis.facts, Patience(0.0, 0.0))
    coming_plans = coming(site, planned(site)) if site.setups else ()
    if coming_plans:
        yield "errors", Visits(coming_plans)


def _loads(made: _For) -> Iterator[tuple[str, Order]]:
    """One batch for each layer, as a push sends them; without a proposal the example tables of all axes."""
    if made.proposal is None:
        batch = tuple(_order(made, table, "table") for table in made.tables)
        if batch:
            yield "axis", batch
        return
    layers: tuple[Literal["axis", "cross"], ...] = ("axis", "cross")
    for layer in layers:
        changes = [one for one in made.proposal.changes if not one.skipped and one.layer == layer]
        places = {
            name: place_of_all(
                [one for one in changes if one.new.input_axis == name], _moved(made, name).facts, ON_PAPER
            )
            for name in dict.fromkeys(one.new.input_axis for one in changes)
        }
        orders = [(_order(made, change.new, "table"), places[change.new.input_axis]) for change in changes]
        batch = tuple(order if place is None else replace(order, agreeing_position=place) for order, place in orders)
        if batch:
            yield layer, batch


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


def _of_axis(made: _For, axis: AxisSection, what: What) -> Iterator[tuple[str, Order]]:
    if what == "backup":
        yield axis.letter, question(axis.facts, Patience(0.0, 0.0))
    elif what == "self-test":
        yield axis.letter, SelfTest(axis.name, axis.encoder, axis.encoder_said)
    elif what == "proof":
        yield from _proof(made, axis)
    else:
        yield axis.letter, DisableOrder(made.number, "axis", axis.name, axis.encoder)


def _moved(made: _For, name: str) -> AxisSection:
    return next(axis for axis in made.site.axes if axis.name == name)


def _order(made: _For, table: CompensationTable, purpose: Literal["table", "sign-proof"]) -> PushOrder:
    moved, output = _moved(made, table.input_axis), _moved(made, table.output_axis)
    return PushOrder(
        made.number,
        table,
        letter=moved.letter,
        rotary=moved.kind == "rotary",
        enable=purpose == "table",
        agreeing_position=moved.reference,
        purpose=purpose,
        proof=_proof_of(made, table) if purpose == "table" else None,
        encoder=output.encoder,
        encoder_said=output.encoder_said,
    )


def _proof_of(made: _For, table: CompensationTable) -> SignProof:
    """The machine's own; where none is kept yet, one of the usual sense."""
    machine, axis = made.machine, table.output_axis
    found = Proofs(store_of(made.site, made.path).root).find(machine, table.kind, axis)
    return found or SignProof(machine, table.kind, output_axis=axis, slope=1.0, slope_u=0.01, sign=1, date_utc="")


def _proof(made: _For, axis: AxisSection) -> Iterator[tuple[str, Order]]:
    """The triangle table, the stops that switch it, and the old table back."""
    table, peak = _triangle(axis)
    order = _order(made, table, "sign-proof")
    yield f"{axis.letter}-triangle", (order,)
    stops = tuple(
        Stop(peak, 1, repetition=turn // 2, label=turn, switch=bool(turn % 2)) for turn in range(2 * TIMES + 1)
    )
    setup = f"TRUEFLANK SETUP {axis.measure.component} ON {axis.letter}"
    switching: StopPlan = plan_of(axis, stops, setup, name=f"TFSIGN{axis.letter}", dwell_s=axis.measure.dwell_s)
    yield f"{axis.letter}-switching", switching
    nothing = replace(table, deviations=tuple(0.0 for _ in table.deviations))
    yield f"{axis.letter}-restore", (replace(order, table=nothing, enable=False, purpose="restore"),)
