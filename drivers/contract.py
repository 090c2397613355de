"""What every controller behind the port must do, as checks that anybody can run on a control of their own.

A check is a coroutine function of a `Subject`: an open controller on a machine (better: on its double) where one table
may be written, and somebody who acts there as a person would. It returns nothing, or raises `ContractBroken` naming
the rule; what the port itself raises passes on. Checks may be run in any order, each on a fresh subject. They know no
test framework: `for check in CHECKS: await check(subject)`. Here nothing is asked of one maker.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

from drivers.errors import DeviceError, TableError, TrueflankError, UnsupportedDevice
from drivers.ports.controller import Controller
from drivers.ports.devices import Tell
from drivers.terms import TableKind
from drivers.types.orders import DisableOrder, PushOrder, ReadBack, SignProof, TableQuestion
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense

T = TypeVar("T")


OperatorMoment = Literal["read", "start", "release", "restart"]
"""When a person acts: tables are read, the load begins, the loaded table is released, the control takes it over."""


OperatorAct = Callable[[OperatorMoment, Coroutine[Any, Any, Any]], Awaitable[Any]]


class ContractBroken(TrueflankError):
    """A controller does not do what the port promises; rule and finding are in the fields."""


def _ignore(_code: str, /, **_fields: object) -> None:
    """Nobody needs to be told."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A controller to be judged, open, its machine ready and without a table in the place of ``table``.

    ``table`` is one it can hold, at its resolution, zero at ``agreeing_position``; ``letter`` and ``rotary`` are those
    of its input axis. ``person`` runs a piece of the talk while somebody does at the machine what that moment asks: at
    "read" and "start" where a program is selected, start it; ``tell`` hears what the driver says of that.
    ``allowed`` (um or arcsec) is the control's resolution.
    Timeouts in s of the controller's clock;
    """

    controller: Controller
    table: CompensationTable
    letter: str
    rotary: bool
    agreeing_position: float
    person: OperatorAct
    tell: Tell = _ignore
    allowed: float = 0.001
    timeout_s: float = 200.0

    async def live(self, axis: str) -> LiveSet:
        """The live tables of an axis by the port's own call."""
        table = self.table
        question = TableQuestion(
            axis=axis,
            letter=self.letter,
            unit=table.output_unit,
            rotary=self.rotary,
            encoder=table.index if table.kind == "axis" else 0,
            start_s=self.timeout_s,
        )
        found: LiveSet = await self.person("read", self.controller.live_tables(question, self.tell))
        return found

    @property
    def place(self) -> DisableOrder:
        """The table's place, for looking at its switch."""
        table = self.table
        return DisableOrder(1, table.kind, table.output_axis, table.index)

    def order(self, number: int, table: CompensationTable, *, enable: bool = True, restore: bool = False) -> PushOrder:
        """An order for a table as it is stored, without any proof."""
        purpose: Literal["sign-proof", "restore"] = "restore" if restore else "sign-proof"
        return PushOrder(
            number,
            table,
            letter=self.letter,
            rotary=self.rotary,
            enable=enable,
            agreeing_position=self.agreeing_position,
            purpose=purpose,
        )


def require(rule: str, held: bool, found: object) -> None:
    if not held:
        raise ContractBroken("E-PORT-CONTRACT", "contract", rule=rule, found=found)


def table_in(live: LiveSet, table: CompensationTable) -> LiveTable | None:
    if table.kind == "axis":
        return live.own
    return next((one for one in live.cross if one.table.index == table.index), None)


def same_tables(subject: Subject, one: CompensationTable, two: CompensationTable) -> bool:
    """Whether two tables have one place, one grid and values within the control's resolution."""
    grids = [(t.kind, t.input_axis, t.output_axis, t.index, len(t.deviations), len(t.reverse)) for t in (one, two)]
    if grids[0] != grids[1] or any(abs(a - b) > 1e-6 for a, b in zip(one.positions, two.positions, strict=True)):
        return False
    pairs = (*zip(one.deviations, two.deviations, strict=True), *zip(one.reverse, two.reverse, strict=True))
    return all(abs(a - b) <= subject.allowed for a, b in pairs)


def holds_nothing(table: LiveTable | None) -> bool:
    return table is None or not table.enabled or not any((*table.table.deviations, *table.table.reverse))


# Checks of what a controller says of itself, its machine and its tables; nothing is written.


async def says_what_it_can(subject: Subject) -> None:
    """Abilities are declared, do not contradict each other, and hold for the machine's own state."""
    can = subject.controller.capabilities
    kinds = [one.kind for one in can.tables]
    require("it holds at least one kind of table, each said once", 0 < len(set(kinds)) == len(kinds), kinds)
    require("who switches at a stop makes stops", can.stops or can.switched != "at-stop", can.switched)
    require(
        "most points, where they are fixed, make a table", all((one.most_points or 2) >= 2 for one in can.tables), can
    )
    state = await subject.controller.state()
    require("without alarms in its abilities it names none", can.alarms or not state.alarms, state.alarms)
    marker = await subject.controller.marker()
    require("it has a marker if and only if it says so", (marker is not None) == can.marker, marker)


async def names_its_machine(subject: Subject) -> None:
    """The fingerprint is the same at each reading, and every axis it names has a state in its unit."""
    first, second = await subject.controller.identify(), await subject.controller.identify()
    require("the fingerprint stays", not first.differences(second), first.differences(second))
    require("serial number and version are no empty texts", bool(first.serial and first.version), first)
    state = await subject.controller.state()
    require("each axis has a state", set(first.axis_names) <= set(state.axes), sorted(state.axes))
    output = state.axes[subject.table.output_axis]
    require("units are those of the table", output.unit == subject.table.output_unit, output.unit)


async def bounds_its_tables(subject: Subject) -> None:
    """Limits of each kind it holds; a kind it has not is refused, or has no room."""
    table, can = subject.table, subject.controller.capabilities
    limits = await subject.controller.table_limits(table.output_axis, table.kind, table.index)
    require("there is room for the table", limits.reserved_points >= len(table.deviations), limits)
    require("its values have a resolution and a limit", limits.resolution > 0.0 and limits.max_value > 0.0, limits)
    most = [one.most_points for one in can.tables if one.kind == table.kind]
    require("no more room than the kind has", most[0] is None or limits.reserved_points <= most[0], limits)
    for kind in _KINDS:
        if can.table(kind) is None:
            require(f"no room for {kind} tables it has not", await _refuses_limits(subject, kind), kind)


_KINDS: tuple[TableKind, ...] = ("axis", "cross")


async def _refuses_limits(subject: Subject, kind: TableKind) -> bool:
    try:
        limits = await subject.controller.table_limits(subject.table.output_axis, kind, 0)
    except DeviceError:
        return True
    return limits.reserved_points == 0


async def shows_what_acts(subject: Subject) -> None:
    """Live sets belong to their axis, hold kinds it has, and have a digest that stays while the tables do."""
    axis = subject.table.output_axis
    live = await subject.live(axis)
    require("the set is of the axis asked for", live.axis == axis and live.own.table.output_axis == axis, live.axis)
    require("the axis' own table is of that kind", live.own.table.kind == "axis", live.own.table.kind)
    held = subject.controller.capabilities.table("cross")
    require("cross tables only where it has them", held is not None or not (live.cross or live.others), live.cross)
    require("the set has a digest", len(live.digest) == 64, live.digest)
    require("read twice it is the same", (await subject.live(axis)).digest == live.digest, live.digest)


async def means_what_the_proof_says(subject: Subject) -> None:
    """A proof changes what cross tables mean and nothing else; without it they are as stored, read or kept."""
    controller, table = subject.controller, subject.table
    live, machine = await subject.live(table.output_axis), await controller.identify()
    require("read without a proof they are as stored", controller.tables_by(live, None) == live, live.sense)
    signs: tuple[Sense, Sense] = (1, -1)
    for sign in signs:
        proof = SignProof(machine, "cross", table.output_axis, slope=-1.0 * sign, slope_u=0.01, sign=sign, date_utc="")
        meant = controller.tables_by(live, proof)
        require("the axis' own table and the digest stay", (meant.own, meant.digest) == (live.own, live.digest), meant)
        require("the way there leads back", controller.tables_by(meant, None) == live, meant.sense)
        own = replace(table, kind="axis", input_axis=table.output_axis)
        require("an axis table means what it says", controller.table_by(own, 1, proof) == own, own)


# Checks that load tables, release, restore and switch them.


async def _load(subject: Subject, order: PushOrder) -> tuple[LiveSet, LiveSet]:
    controller = subject.controller
    await controller.stage((order,))
    loaded: tuple[ReadBack, ...] = await subject.person("start", controller.read_back((order,), subject.timeout_s))
    require("the control found as sent what it took", loaded[0].agreed, loaded)
    return loaded[0].backup, loaded[0].found


async def _to_work(subject: Subject, order: PushOrder) -> bool:
    controller = subject.controller
    await controller.activate((order,), (order,))
    enabled: tuple[bool, ...] = await subject.person("release", controller.confirm((order,), subject.timeout_s))
    if enabled == (True,) or _tried_later(subject, order):
        await subject.person("restart", controller.restarted((order,), subject.timeout_s))
    return enabled == (True,)


def _tried_later(subject: Subject, order: PushOrder) -> bool:
    """A trial table that is left off waits for the restart as well, where programs switch it at their stops."""
    can = subject.controller.capabilities
    return order.purpose == "sign-proof" and not order.enable and can.stops and can.switches_now


async def loads_and_acts(subject: Subject) -> None:
    """Stage, read back, activate, confirm: off until it is released, then as it was ordered."""
    order, axis = subject.order(701, subject.table), subject.table.output_axis
    before = await subject.live(axis)
    backup, loaded = await _load(subject, order)
    was, now = table_in(backup, order.table), table_in(loaded, order.table)
    require("the back-up is what stood before", holds_nothing(was) == holds_nothing(table_in(before, order.table)), was)
    require("what was sent is read back", now is not None and same_tables(subject, now.table, order.table), now)
    require("it stays off until it is released", now is not None and not now.enabled, now)
    await _marked(subject, order, "in-progress")
    require("a released table is switched on", await _to_work(subject, order), False)
    await subject.controller.finish_push((order,), "committed")
    await _marked(subject, order, "committed")
    after = await subject.live(axis)
    require("another table has another digest", after.digest != before.digest, after.digest)
    acts = table_in(after, order.table)
    right = acts is not None and acts.enabled and same_tables(subject, acts.table, order.table)
    require("then it acts as it was ordered", right, acts)
    reading = await subject.controller.switch_reading(subject.place)
    require("and its switch reads on", reading.enabled is True and not reading.off, reading)


async def _marked(subject: Subject, order: PushOrder, state: str) -> None:
    if not subject.controller.capabilities.marker:
        return
    marker = await subject.controller.marker()
    found = (marker.transaction, marker.state) if marker is not None else None
    require("the marker names transaction and state", found == (order.transaction, state), found)


async def stays_off_where_told(subject: Subject) -> None:
    """An order that does not enable ends loaded and off."""
    order = subject.order(702, subject.table, enable=False)
    await _load(subject, order)
    require("it says that it left the table off", not await _to_work(subject, order), True)
    await subject.controller.finish_push((order,), "held")
    held = table_in(await subject.live(order.table.output_axis), order.table)
    require("and it is off", held is None or not held.enabled, held)


async def restores(subject: Subject) -> None:
    """After a push the back-up goes in by an order of its own, and what stood before acts again."""
    order = subject.order(703, subject.table)
    backup, _ = await _load(subject, order)
    require("first the new one acts", await _to_work(subject, order), False)
    await subject.controller.finish_push((order,), "committed")
    old = table_in(backup, order.table)
    table = old.table if old is not None else replace(order.table, deviations=(0.0,) * len(order.table.deviations))
    enable = old is not None and old.enabled
    back = subject.order(704, table, enable=enable, restore=True)
    await _load(subject, back)
    require("the order ends as the old one was", await _to_work(subject, back) == enable, enable)
    await subject.controller.finish_push((back,), "committed")
    held = table_in(await subject.live(order.table.output_axis), order.table)
    gone = held is None or not same_tables(subject, held.table, order.table) or not held.enabled
    require("the new one does not act any more", gone, held)


async def refuses_what_it_cannot_hold(subject: Subject) -> None:
    """A kind, a grid or a curve that its abilities lack is refused before anything changes."""
    before = await subject.live(subject.table.output_axis)
    for what, table in _beyond(subject):
        try:
            await subject.controller.stage((subject.order(705, table),))
        except (TableError, DeviceError):
            continue
        require(f"refused before anything is sent: {what}", held=False, found=table.name)
    after = await subject.live(subject.table.output_axis)
    require("and nothing changed", (before.own, before.cross) == (after.own, after.cross), after)


def _beyond(subject: Subject) -> list[tuple[str, CompensationTable]]:
    table, can = subject.table, subject.controller.capabilities
    ability = can.table(table.kind)
    found: list[tuple[str, CompensationTable]] = []
    if can.table("cross") is None:
        found.append(("a cross table", replace(table, kind="cross", index=0)))
    if ability is not None and ability.grid == "equal-step":
        found.append(("points at free positions", replace(table, places=tuple(map(float, table.positions)))))
    if ability is not None and ability.directions != "columns":
        found.append(("a curve for each direction in one table", replace(table, reverse=table.deviations)))
    if ability is not None and ability.most_points is not None:
        count = ability.most_points + 1
        places = tuple(table.minimum + number * 0.01 for number in range(count))
        more: dict[str, Any] = {"deviations": (0.0,) * count, "reverse": (0.0,) * count if table.reverse else ()}
        found.append(("too many points", replace(table, places=places if table.places else (), **more)))
    return found


async def switches_as_declared(subject: Subject) -> None:
    """By itself where it says so; else switching alone is unsupported, and changes nothing."""
    order = subject.order(706, subject.table)
    if subject.controller.capabilities.switched == "by-itself":
        await _load(subject, order)
        await _to_work(subject, order)
        await subject.controller.finish_push((order,), "committed")
        again = replace(order, transaction=707)
        await subject.person("release", subject.controller.switch(again, False, subject.timeout_s))
        reading = await subject.controller.switch_reading(subject.place)
        require("it switches off", reading.enabled is False, reading)
        return
    try:
        await subject.controller.switch(order, False, subject.timeout_s)
    except UnsupportedDevice:
        return
    require("switching alone is unsupported", held=False, found=subject.controller.capabilities.switched)


Check = Callable[[Subject], Coroutine[Any, Any, None]]

CHECKS: tuple[Check, ...] = (
    says_what_it_can,
    names_its_machine,
    bounds_its_tables,
    shows_what_acts,
    means_what_the_proof_says,
    loads_and_acts,
    stays_off_where_told,
    restores,
    refuses_what_it_cannot_hold,
    switches_as_declared,
)
