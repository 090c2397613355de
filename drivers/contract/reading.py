"""Checks of what a controller says of itself, its machine and its tables; nothing is written."""

from __future__ import annotations

from dataclasses import replace

from drivers.contract.subject import Subject, demand
from drivers.errors import DeviceError
from drivers.terms import TableKind
from drivers.types.orders import SignProof
from drivers.types.values import Sense


async def says_what_it_can(subject: Subject) -> None:
    """Abilities are declared, do not contradict each other, and hold for the machine's own state."""
    can = subject.controller.capabilities
    kinds = [one.kind for one in can.tables]
    demand("it holds at least one kind of table, each said once", 0 < len(set(kinds)) == len(kinds), kinds)
    demand("who switches at a stop makes stops", can.stops or can.switched != "at-stop", can.switched)
    demand(
        "most points, where they are fixed, make a table", all((one.most_points or 2) >= 2 for one in can.tables), can
    )
    state = await subject.controller.state()
    demand("without alarms in its abilities it names none", can.alarms or not state.alarms, state.alarms)
    marker = await subject.controller.marker()
    demand("it has a marker if and only if it says so", (marker is not None) == can.marker, marker)


async def names_its_machine(subject: Subject) -> None:
    """The fingerprint is the same at each reading, and every axis it names has a state in its unit."""
    first, second = await subject.controller.identify(), await subject.controller.identify()
    demand("the fingerprint stays", not first.differences(second), first.differences(second))
    demand("serial number and version are no empty texts", bool(first.serial and first.version), first)
    state = await subject.controller.state()
    demand("each axis has a state", set(first.axis_names) <= set(state.axes), sorted(state.axes))
    output = state.axes[subject.table.output_axis]
    demand("units are those of the table", output.unit == subject.table.output_unit, output.unit)


async def bounds_its_tables(subject: Subject) -> None:
    """Limits of each kind it holds; a kind it has not is refused, or has no room."""
    table, can = subject.table, subject.controller.capabilities
    limits = await subject.controller.table_limits(table.output_axis, table.kind, table.index)
    demand("there is room for the table", limits.reserved_points >= len(table.deviations), limits)
    demand("its values have a resolution and a limit", limits.resolution > 0.0 and limits.max_value > 0.0, limits)
    most = [one.most_points for one in can.tables if one.kind == table.kind]
    demand("no more room than the kind has", most[0] is None or limits.reserved_points <= most[0], limits)
    for kind in _KINDS:
        if can.table(kind) is None:
            demand(f"no room for {kind} tables it has not", await _refuses_limits(subject, kind), kind)


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
    demand("the set is of the axis asked for", live.axis == axis and live.own.table.output_axis == axis, live.axis)
    demand("the axis' own table is of that kind", live.own.table.kind == "axis", live.own.table.kind)
    held = subject.controller.capabilities.table("cross")
    demand("cross tables only where it has them", held is not None or not (live.cross or live.others), live.cross)
    demand("the set has a digest", len(live.digest) == 64, live.digest)
    demand("read twice it is the same", (await subject.live(axis)).digest == live.digest, live.digest)


async def means_what_the_proof_says(subject: Subject) -> None:
    """A proof changes what cross tables mean and nothing else; without it they are as stored, read or kept."""
    controller, table = subject.controller, subject.table
    live, machine = await subject.live(table.output_axis), await controller.identify()
    demand("read without a proof they are as stored", controller.tables_by(live, None) == live, live.sense)
    signs: tuple[Sense, Sense] = (1, -1)
    for sign in signs:
        proof = SignProof(machine, "cross", table.output_axis, slope=-1.0 * sign, slope_u=0.01, sign=sign, date_utc="")
        meant = controller.tables_by(live, proof)
        demand("the axis' own table and the digest stay", (meant.own, meant.digest) == (live.own, live.digest), meant)
        demand("the way there leads back", controller.tables_by(meant, None) == live, meant.sense)
        own = replace(table, kind="axis", input_axis=table.output_axis)
        demand("an axis table means what it says", controller.table_by(own, 1, proof) == own, own)
