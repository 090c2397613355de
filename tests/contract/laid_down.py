"""What was written into a PLC's mailbox over the wire, beside what `program` prints of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest

from drivers.programs import DayNumbers
from drivers.sinumerik.mailbox.wire import ModbusWire

HEADER, DATA = 16, 36
CHANGING = {2: "BEGIN", 3: "CHUNK", 4: "VERIFY", 5: "ACTIVATE", 6: "DISABLE", 10: "MARKER"}
"""Commands of docs/plc-mailbox.md that write or switch; the others open, select, read and close."""
Written = tuple[int, tuple[int, ...]]


@dataclass
class WireLog:
    """Every write of several registers since it was made: the first register, and the values."""

    writes: list[Written] = field(default_factory=list)

    @property
    def changing(self) -> list[Written]:
        """Those of commands that write or switch, with the data that went before them."""
        found: list[Written] = []
        data: list[Written] = []
        for first, values in self.writes:
            if first != HEADER:
                data.append((first, values))
                continue
            if values[0] in CHANGING:
                found += [*data, (first, values)]
            data = []
        return found

    def numbers(self, order: int) -> DayNumbers:
        """The numbers of the day that stand in them: of the commands, and the heads beside the marker."""
        heads = [values[9:13] for first, values in self.changing if first == DATA and self._marks(values)]
        said = [sum(word << shift for word, shift in zip(head, (48, 32, 16, 0), strict=True)) for head in heads]
        counts = tuple(values[1] for first, values in self.changing if first == HEADER)
        return DayNumbers(order=order, head=said[0], head_after=said[-1], commands=counts)

    def _marks(self, values: tuple[int, ...]) -> bool:
        """Whether data registers are those of command 10, by the header that follows them."""
        writes = self.changing
        return writes[writes.index((DATA, values)) + 1][1][0] == 10


@pytest.fixture
def wire_log(monkeypatch: pytest.MonkeyPatch) -> WireLog:
    """What goes over the wire from now on."""
    log = WireLog()
    write = ModbusWire.write

    async def kept(self: ModbusWire, address: int, values: Sequence[int]) -> None:
        log.writes.append((address, tuple(values)))
        await write(self, address, values)

    monkeypatch.setattr(ModbusWire, "write", kept)
    return log


def read(text: str) -> list[Written]:
    """The writes that a printed text says, rows that follow one another put together."""
    found: list[Written] = []
    for line in text.splitlines():
        if line.startswith(";"):
            continue
        place, _, row = line.partition(": ")
        values = tuple(int(word, 16) for word in row.split())
        if found and found[-1][0] + len(found[-1][1]) == int(place) and int(place) not in (HEADER, DATA):
            found[-1] = (found[-1][0], found[-1][1] + values)
        else:
            found.append((int(place), values))
    return found
