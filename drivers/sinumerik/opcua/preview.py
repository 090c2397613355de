"""The programs that would be sent, written and checked without a control."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from drivers.errors import DeviceRefused
from drivers.programs import (
    DayNumbers,
    DwellPlan,
    Order,
    Origin,
    PaperMachine,
    ProgramText,
    SelfTest,
    Visits,
    reading_plan,
)
from drivers.sinumerik.ncprogram import grinding, measuring, pushing, selftest, switching
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.checks import Guard, axes_left_safe, check_program, make_guards
from drivers.sinumerik.ncprogram.grinding import GrindSetting
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.words import Word, program_path
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, TableQuestion
from drivers.types.stops import StopPlan
from drivers.workpiece import GrindPlan

SentOrder = Visits | StopPlan | TableQuestion | PushBatch | DisableOrder | GrindPlan | SelfTest


def preview_programs(
    order: Order, settings: Mapping[str, Any], machine: PaperMachine, origin: Origin, where: str
) -> tuple[ProgramText, ...]:
    """The programs of an order in the order in which they are sent; their number is no real one.

    One each; two of a push where the site loads and enables by two; of several plans as many as the site's
    ``plans_per_program`` makes of them.
    Raises ConfigError as `UaSettings.read`, and what writing and judging such a program raise.
    """
    if isinstance(order, DwellPlan):  # it shakes no hands, so it asks for no setting of the road
        axis = order.stops.axis
        loops = selftest.LOOPS not in machine.without
        texts = [
            (
                program_path("DWEL", axis),
                measuring.build_dwell_program(order, axis in machine.modulo, origin, loops=loops),
            )
        ]
    else:
        texts = _texts(order, UaSettings.read(settings, where), machine, origin)
    stays = grinding.fixed_axes(order) if isinstance(order, GrindPlan) else ()
    return tuple(check_program(path, text, machine.axes, still=stays).program for path, text in texts)


def program_numbers(text: str, settings: Mapping[str, Any], where: str) -> DayNumbers | None:
    """The numbers of a program as it was sent; None where it shows none.

    It names its own in a block that sets the word of the transaction; one that checks it does so where none sets it.
    """
    name = UaSettings.read(settings, where).words.name(Word.TRANSACTION)
    sets, checks = rf"^{name}=(\d{{2,}})$", rf"^IF {name}<>(\d+) "
    found = re.search(sets, text, re.MULTILINE) or re.search(checks, text, re.MULTILINE)
    return DayNumbers(order=int(found[1])) if found is not None else None


def _texts(order: SentOrder, settings: UaSettings, machine: PaperMachine, origin: Origin) -> list[tuple[str, str]]:
    if isinstance(order, TableQuestion):
        order = reading_plan(order)
    if isinstance(order, StopPlan):
        order = Visits((replace(order, further=False),))
    if isinstance(order, Visits):
        return _visits(order.plans, settings, machine, origin)
    if isinstance(order, tuple):
        return _push(order, settings, machine, origin)
    if isinstance(order, DisableOrder):
        setting = _setting(order.axis, order.axis, settings, machine, origin)
        return [(program_path("OFF", order.axis), switching.build_disable_program(order, setting))]
    if isinstance(order, SelfTest):
        setting = _setting(order.axis, order.axis, settings, machine, origin)
        text = selftest.build_self_test_program(order.axis, order.encoder, machine.number, setting)
        return [(program_path("SELF", order.axis), text)]
    memory = {axis.name: _memory(axis.name, machine) for axis in order.compensated}
    guards = _guards(machine, *(axis.name for axis in order.axes))
    given = GrindSetting(
        settings.words,
        memory,
        order.index.name in machine.modulo,
        origin=origin,
        guards=guards,
        loops=selftest.LOOPS not in machine.without,
    )
    return [(program_path("GRIND", order.index.name), grinding.build_grinding_program(order, machine.number, given))]


def _visits(
    plans: Sequence[StopPlan], settings: UaSettings, machine: PaperMachine, origin: Origin
) -> list[tuple[str, str]]:
    """As many plans in each program as the site wants together; an axis stands where the plan before left it."""
    parts = []
    safe = set(machine.axes)
    for plan in plans:
        setting = _setting(plan.axis, plan.compensated_axis, settings, machine, origin)
        parts.append((plan, replace(setting, guards=make_guards(machine.places, machine.axes, safe - {plan.axis}))))
        safe = axes_left_safe(safe, plan, machine.places)
    count = settings.plans_together
    together = [parts[first : first + count] for first in range(0, len(parts), count)]
    return [
        (program_path("MEAS", some[0][0].compensated_axis), measuring.build_chained_program(some, machine.number))
        for some in together
    ]


def _push(batch: PushBatch, settings: UaSettings, machine: PaperMachine, origin: Origin) -> list[tuple[str, str]]:
    loads: list[tuple[PushOrder, MachineSetting]] = []
    for order in batch:
        setting = _setting(order.table.input_axis, order.table.output_axis, settings, machine, origin)
        feed, guards = machine.places.feed(order.table.input_unit), _guards(machine)
        loads.append((order, replace(setting, approach_feed=feed, guards=guards)))
    writers = (
        {"LOAD": pushing.build_loading_program, "ENAB": pushing.build_enabling_program}
        if settings.two_programs
        else {"PUSH": pushing.build_push_program}
    )
    axis = batch[0].table.output_axis
    return [(program_path(purpose, axis), write(loads)) for purpose, write in writers.items()]


def _setting(
    moved: str, compensated: str, settings: UaSettings, machine: PaperMachine, origin: Origin
) -> MachineSetting:
    missing = next((name for name in (moved, compensated) if name not in machine.axes), "")
    if missing:
        raise DeviceRefused("E-NC-AXIS", origin.site, axis=missing, known=", ".join(machine.axes))
    return MachineSetting(
        words=settings.words,
        memory=_memory(compensated, machine),
        modulo=moved in machine.modulo,
        axis_number=machine.axes.index(moved) + 1,
        wait_limit_s=settings.wait_limit_s,
        origin=origin,
        loops=selftest.LOOPS not in machine.without,
    )


def _guards(machine: PaperMachine, *moved: str) -> tuple[Guard, ...]:
    """Every axis with a safe place but those that are ``moved``; at the machine only those that stand in it."""
    return make_guards(machine.places, machine.axes, set(machine.axes) - set(moved))


def _memory(axis: str, machine: PaperMachine) -> ReservedPoints:
    return ReservedPoints(machine.own_points.get(axis, 0), machine.cross_points, machine.axes, machine.file_kb)
