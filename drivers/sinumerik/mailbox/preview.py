"""The register writes of a push or of an order to switch off, listed without a PLC.

No program goes to a PLC: what a person can read and sign are the commands that write or switch. Between them the
gateway opens a session, selects tables and reads, which changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from drivers.errors import ConfigError
from drivers.programs import DayNumbers, Order, Origin, PaperMachine, ProgramText
from drivers.sinumerik.mailbox.codec import frames, grids
from drivers.sinumerik.mailbox.codec.frames import (
    CommandFrame,
    encode_command,
    marker_data,
    switching_command,
    value_chunks,
)
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis
from drivers.sinumerik.mailbox.codec.registers import (
    ADDRESS,
    DATA_SPAN,
    KINDS,
    MAP_VERSION,
    Command,
    TableFlag,
    pack_dints,
)
from drivers.sinumerik.mailbox.pushing import plan_numbers, split_batches
from drivers.sinumerik.mailbox.reader import MARKER_STATES, table_order
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.switching import command_entries
from drivers.types.orders import DisableOrder, PushBatch
from drivers.units import AxisUnit

MailboxWrite = tuple[frames.MailboxOrder, Sequence[int], Sequence[int]]
"""One command, its data registers, and the value registers of the whole table that its CRC is taken over."""
_IN_A_ROW = 10


def preview_writes(
    order: Order, settings: Mapping[str, Any], machine: PaperMachine, origin: Origin, where: str
) -> tuple[ProgramText, ...]:
    """The writes of a push or of an order to switch off, as one text; nothing for what this road does not do.

    Axes have the numbers and MD32452 of the settings, which a push compares with the PLC's: the text states both.
    Raises ConfigError (E-MBX-NOT-ASKED for axes that nobody has numbered: neither the settings nor the PLC) and as
    `ModbusSettings.read`, and what a table raises that the map cannot say.
    """
    own = ModbusSettings.read(settings, where)
    if isinstance(order, tuple):
        axes = _axes(machine, _units(order), own, where)
        laid, name = list(_pushed(order, axes, own, machine.numbers, where)), f"TFLOAD_{order[0].table.output_axis}"
    elif isinstance(order, DisableOrder):
        axes = _axes(machine, {}, own, where)
        named = table_order(axes[order.axis], KINDS[order.kind], order.index)
        told, data = switching_command(Command.DISABLE, [named], int(TableFlag.ANYHOW))
        laid, name = [(told, data, ())], f"TFOFF_{order.axis}"
    else:
        return ()
    head = [f"; {name}: what is written into the PLC mailbox, map version {MAP_VERSION}, in this order"]
    head += [f"; Site {origin.site}, machine {origin.machine}, trueflank {origin.version}"]
    head += [f"; Axes by number (MD32452): {', '.join(_named(axis) for axis in axes.values())}"]
    head += [f"; Registers as they pass on the wire, hexadecimal, word order {own.word_order}: first register: values"]
    head += ["; Register 17 is the command's number, 34-35 the CRC over it: both are those of the day"]
    numbers = (*machine.numbers.commands, *(0 for _ in laid))
    body: list[str] = []
    for (command, registers, whole), number in zip(laid, numbers, strict=False):
        body += [f"; command {int(command.command)} {command.command.name}"]
        body += _rows(encode_command(command, number, own.order, data=registers, whole=whole))
    return (ProgramText(f"/_N_{name}_TXT", "\n".join([*head, *body, ""])),)


def _units(batch: PushBatch) -> dict[str, AxisUnit]:
    units = {order.table.input_axis: order.table.input_unit for order in batch}
    return units | {order.table.output_axis: order.table.output_unit for order in batch}


def _axes(
    machine: PaperMachine, units: Mapping[str, AxisUnit], own: ModbusSettings, where: str
) -> dict[str, MailboxAxis]:
    open_ones = [name for name in machine.axes if name not in own.axis_numbers]
    if open_ones and (own.axis_numbers or not machine.seen):  # a number that is left out may be that of another
        raise ConfigError("E-MBX-NOT-ASKED", where, axes=", ".join(open_ones))
    return {
        name: MailboxAxis(number, name, units.get(name, "mm"), name in machine.modulo, factor=factor)
        for name, (number, factor) in own.numbered(machine.axes).items()
    }


def _named(axis: MailboxAxis) -> str:
    return f"{axis.number} {axis.name} ({axis.factor.normalize():f})"


def _pushed(
    batch: PushBatch, axes: Mapping[str, MailboxAxis], own: ModbusSettings, numbers: DayNumbers, where: str
) -> Iterator[MailboxWrite]:
    """Marker, all off, each table loaded and verified, those that shall act switched on, marker."""
    plans = [plan_numbers(order, axes, where) for order in batch]
    yield frames.MailboxOrder(Command.MARKER), _marked(batch, "in-progress", numbers.head), ()
    for some in split_batches([plan.begin for plan in plans]):
        yield *switching_command(Command.DISABLE, some), ()
    for plan in plans:
        yield plan.begin, (), ()
        for first, count, data in value_chunks(plan.values, own.order):
            yield plan.begin.as_command(Command.CHUNK, first, count), data, ()
        yield plan.begin.as_command(Command.VERIFY), (), pack_dints(plan.values, own.order)
    if entries := command_entries(batch, axes):
        yield *switching_command(Command.ACTIVATE, entries), ()
    elif batch[0].purpose == "sign-proof":  # on and off by turns, as often as the proof needs
        tried = [grids.naming_order(order.table, axes) for order in batch]
        yield *switching_command(Command.ACTIVATE, tried), ()
        yield *switching_command(Command.DISABLE, tried), ()
    yield frames.MailboxOrder(Command.MARKER), _marked(batch, "committed", numbers.head_after), ()


def _marked(batch: PushBatch, state: str, head: int) -> tuple[int, ...]:
    return marker_data(str(batch[0].transaction), [str(one) for one in MARKER_STATES].index(state), head)


def _rows(frame: CommandFrame) -> Iterator[str]:
    """Data registers first, then the header, as they are written."""
    for first, registers in ((DATA_SPAN[0], frame.data), (ADDRESS["COMMAND"], frame.header)):
        for place in range(0, len(registers), _IN_A_ROW):
            row = " ".join(f"{register:04X}" for register in registers[place : place + _IN_A_ROW])
            yield f"{first + place}: {row}"
