"""Commands of the PC <-> registers 16-35 and 36-135, with the CRC over what each command carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from drivers.sinumerik.mailbox.codec.packing import WordOrder, crc32, dint, dints, number, text, unsigned, unsigned_pair
from drivers.sinumerik.mailbox.codec.registers import (
    CHUNK_POINTS,
    DATA_SPAN,
    HEAD_REGISTERS,
    LAST_NUMBER,
    NAME_REGISTERS,
    Command,
    Kind,
    TableFlag,
)

_ALONE = int(TableFlag.AXIS_ONLY | TableFlag.TABLE_ONLY)
WITH_DATA = (Command.CHUNK, Command.MARKER, Command.ACTIVATE, Command.DISABLE)


@dataclass(frozen=True, slots=True)
class Order:
    """One command as numbers: positions in 0.1 um or 1e-6 deg. What a command does not name stays 0."""

    command: Command
    kind: Kind = Kind.NONE
    index: int = 0
    encoder: int = 0
    flags: int = 0
    minimum: int = 0
    step: int = 0
    maximum: int = 0
    total: int = 0
    first: int = 0
    count: int = 0
    input_axis: int = 0
    output_axis: int = 0
    multiply_by: int = 0

    def as_command(self, command: Command, first: int = 0, count: int = 0) -> Order:
        """The same table named by another command."""
        return replace(self, command=command, first=first, count=count)


_NUMBERS = [field.name for field in fields(Order)][2:]  # in the order of the registers


@dataclass(frozen=True, slots=True)
class CommandFrame:
    """A command ready for the wire: ``data`` (registers 36-135, empty for none) goes first, then ``header`` (16-35)."""

    header: tuple[int, ...]
    data: tuple[int, ...]
    crc: int


def next_number(taken: int) -> int:
    """The number that follows register 6."""
    return taken % LAST_NUMBER + 1


def encode(
    order: Order, count: int, word_order: WordOrder, data: Sequence[int] = (), whole: Sequence[int] = ()
) -> CommandFrame:
    """Registers of a command under the number ``count``.

    ``data`` are the data registers of commands 3, 5, 6 and 10, ``whole`` all value registers of a table for command 4.
    Raises OverflowError for a number that does not fit its register.
    """
    body = _body(order, count, word_order)
    block: tuple[int, ...] = ()
    if order.command in WITH_DATA:
        block = tuple(data) + (0,) * (DATA_SPAN[1] - len(data))
    crc = crc32(body, block, whole)
    return CommandFrame((*body, *unsigned_pair(crc, word_order)), block, crc)


def _body(order: Order, count: int, word_order: WordOrder) -> tuple[int, ...]:
    body = (
        int(order.command),
        count,
        int(order.kind),
        order.index,
        order.encoder,
        order.flags,
        *dint(order.minimum, word_order),
        *dint(order.step, word_order),
        *dint(order.maximum, word_order),
        order.total,
        order.first,
        order.count,
        order.input_axis,
        order.output_axis,
        order.multiply_by,
    )
    if not all(0 <= register <= 0xFFFF for register in body):
        raise OverflowError(order)
    return body


@dataclass(frozen=True, slots=True)
class Received:
    """A command as the PLC's side reads it; ``sound`` tells whether its CRC is right."""

    order: Order
    count: int
    sound: bool


def decode(
    header: Sequence[int], word_order: WordOrder, data: Sequence[int] = (), whole: Sequence[int] = ()
) -> Received:
    """Registers 16-35 back into a command. Raises ValueError for a command or kind that does not exist."""
    body = tuple(header[:18])
    grid = (number(body[at : at + 2], word_order) for at in (6, 8, 10))
    values = dict(zip(_NUMBERS, (*body[3:6], *grid, *body[12:18]), strict=True))
    order = Order(Command(body[0]), Kind(body[2]), **values)
    block = tuple(data) if order.command in WITH_DATA else ()
    sound = unsigned(header[18:20], word_order) == crc32(body, block, whole)
    return Received(order, body[1], sound)


def chunks(values: Sequence[int], word_order: WordOrder) -> list[tuple[int, int, tuple[int, ...]]]:
    """(first point, number of points, data registers) of each chunk; a value is never split over two of them."""
    return [
        (first, len(part), dints(part, word_order))
        for first in range(0, len(values), CHUNK_POINTS)
        for part in [values[first : first + CHUNK_POINTS]]
    ]


def marker_data(transaction: str, state: int, head: int = 0) -> tuple[int, ...]:
    """Data registers of command 10: the number in digits, the state, and 64 bits of the audit log's head."""
    parts = (head >> shift & 0xFFFF for shift in range(16 * (HEAD_REGISTERS - 1), -1, -16))
    return (*text(transaction, NAME_REGISTERS), state, *parts)


def switching(command: Command, tables: Sequence[Order], flags: int = 0) -> tuple[Order, tuple[int, ...]]:
    """Commands 5 and 6 for several tables, and their data registers: an entry for each, in this order.

    Of a table's flags its entry takes those of the switches; ``flags`` are the command's own (register 21).
    """
    data: list[int] = []
    for one in tables:
        data += (int(one.kind), one.index, one.encoder, axis_of(one), one.flags & _ALONE)
    return Order(command, flags=flags, count=len(tables)), tuple(data)


def axis_of(order: Order) -> int:
    """The axis that a table is looked at by: the output axis of a cross table, else the index."""
    return order.output_axis if order.kind is Kind.CEC else order.index
