"""Checks that load tables, release, restore and switch them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers.contract.subject import Subject, demand, held_in, holds_nothing, same_tables
from drivers.errors import DeviceError, TableError, UnsupportedDevice
from drivers.types.orders import PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet


async def _load(subject: Subject, order: PushOrder) -> tuple[LiveSet, LiveSet]:
    controller = subject.controller
    await controller.stage((order,))
    loaded: tuple[ReadBack, ...] = await subject.person("start", controller.read_back((order,), subject.timeout_s))
    demand("the control found as sent what it took", loaded[0].agreed, loaded)
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
    was, now = held_in(backup, order.table), held_in(loaded, order.table)
    demand("the back-up is what stood before", holds_nothing(was) == holds_nothing(held_in(before, order.table)), was)
    demand("what was sent is read back", now is not None and same_tables(subject, now.table, order.table), now)
    demand("it stays off until it is released", now is not None and not now.enabled, now)
    await _marked(subject, order, "in-progress")
    demand("a released table is switched on", await _to_work(subject, order), False)
    await subject.controller.finish_push((order,), "committed")
    await _marked(subject, order, "committed")
    after = await subject.live(axis)
    demand("another table has another digest", after.digest != before.digest, after.digest)
    acts = held_in(after, order.table)
    right = acts is not None and acts.enabled and same_tables(subject, acts.table, order.table)
    demand("then it acts as it was ordered", right, acts)
    reading = await subject.controller.switch_reading(subject.place)
    demand("and its switch reads on", reading.enabled is True and not reading.off, reading)


async def _marked(subject: Subject, order: PushOrder, state: str) -> None:
    if not subject.controller.capabilities.marker:
        return
    marker = await subject.controller.marker()
    found = (marker.transaction, marker.state) if marker is not None else None
    demand("the marker names transaction and state", found == (order.transaction, state), found)


async def stays_off_where_told(subject: Subject) -> None:
    """An order that does not enable ends loaded and off."""
    order = subject.order(702, subject.table, enable=False)
    await _load(subject, order)
    demand("it says that it left the table off", not await _to_work(subject, order), True)
    await subject.controller.finish_push((order,), "held")
    held = held_in(await subject.live(order.table.output_axis), order.table)
    demand("and it is off", held is None or not held.enabled, held)


async def restores(subject: Subject) -> None:
    """After a push the back-up goes in by an order of its own, and what stood before acts again."""
    order = subject.order(703, subject.table)
    backup, _ = await _load(subject, order)
    demand("first the new one acts", await _to_work(subject, order), False)
    await subject.controller.finish_push((order,), "committed")
    old = held_in(backup, order.table)
    table = old.table if old is not None else replace(order.table, deviations=(0.0,) * len(order.table.deviations))
    enable = old is not None and old.enabled
    back = subject.order(704, table, enable=enable, restore=True)
    await _load(subject, back)
    demand("the order ends as the old one was", await _to_work(subject, back) == enable, enable)
    await subject.controller.finish_push((back,), "committed")
    held = held_in(await subject.live(order.table.output_axis), order.table)
    gone = held is None or not same_tables(subject, held.table, order.table) or not held.enabled
    demand("the new one does not act any more", gone, held)


async def refuses_what_it_cannot_hold(subject: Subject) -> None:
    """A kind, a grid or a curve that its abilities lack is refused before anything changes."""
    before = await subject.live(subject.table.output_axis)
    for what, table in _beyond(subject):
        try:
            await subject.controller.stage((subject.order(705, table),))
        except (TableError, DeviceError):
            continue
        demand(f"refused before anything is sent: {what}", held=False, found=table.name)
    after = await subject.live(subject.table.output_axis)
    demand("and nothing changed", (before.own, before.cross) == (after.own, after.cross), after)


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
        demand("it switches off", reading.enabled is False, reading)
        return
    try:
        await subject.controller.switch(order, False, subject.timeout_s)
    except UnsupportedDevice:
        return
    demand("switching alone is unsupported", held=False, found=subject.controller.capabilities.switched)
