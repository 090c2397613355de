"""The text of docs/plc and the simulated PLC, each in front of a control of its own, given the same random commands."""

from __future__ import annotations

import random
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.clock import LoopClock, run_virtual
from simulators.modbus import Plc, PlcSettings
from simulators.nck import AxisSpec, NckRefusal
from tests.unit.mailbox.plant import SCAN_MS, TextPlc
from tests.unit.mailbox.structured import Library
from tests.unit.nck.bench import MAIN, Bench

AXES = (
    AxisSpec("X1", "X", travel=(-300.0, 700.0), eec_points=(30, 8)),
    AxisSpec("Z1", "Z", travel=(-100.0, 600.0), eec_points=(0, 0)),
    AxisSpec("C1", "C", rotary=True, modulo=True, max_velocity=7200.0, eec_points=(70, 5), absolute_encoder=True),
)
SPEC: dict[str, Any] = {"axes": AXES, "cec_points": (12, 55, 4), "strict_activation": False, "access_level": 4}
OPEN, BEGIN, CHUNK, VERIFY, ACTIVATE, DISABLE, READ, ABORT, CLOSE, MARKER, SELECT = range(1, 12)
BUSY, DONE, FAILED, WAITING = 2, 4, 8, 0x1000
HEAD = (5, 6, 7, 8, 9, 10, 11, 12, 13, 14)
AREAS = ((200, 102), (302, 86))
ALARM = 700016
ODD = (0, 1, 2, 3, 4, 5, 6, 9, 0x10, 0x11, 50, 51, 61, 0x7FFF, 0x8000, 0xFFFF)
TOO_LONG = 4000
RESTLESS = {5, *range(302, 306), 355, 366, *range(369, 375)}  # what follows the machine, refreshed twice a second
LOOK = 7
FATES = {"press": 12, "disturb": 3, "other": 2, "nobody": 1, "silence": 1}  # of a command that waits, by weight


def crc(words: Sequence[int]) -> int:
    """CRC-32 over registers, high byte first."""
    return zlib.crc32(struct.pack(f">{len(words)}H", *words))


@dataclass
class Load:
    """What the PC knows of the table it loads."""

    head: list[int]
    words: list[int] = field(default_factory=list)
    stored: int = 0


class Pair:
    """Both PLCs, their controls and one PC in front of both."""

    def __init__(self, read: Library, seed: str, *, low_first: bool = False, **spec: Any) -> None:
        self.chance = random.Random(seed)
        self.low_first = low_first
        self.clock = LoopClock()
        self.benches = (Bench(**{**SPEC, **spec}), Bench(**{**SPEC, **spec}))
        order = "low-first" if low_first else "high-first"
        self.double = Plc(self.benches[0].nck, self.clock, PlcSettings.of({"word_order": order}))
        self.text = TextPlc(read, self.benches[1].nck, low_first=low_first)
        self.load: Load | None = None
        self.fates = FATES
        self.beats = self.later = self._cycles = 0
        self.seen: Counter[tuple[int, int]] = Counter()

    async def __aenter__(self) -> Pair:
        for bench in self.benches:
            await bench.nck.start()
            await bench.warm_up()
            bench.load("G4 F600\nM30\n")
        self.double.power_on()
        await self.pass_time(3)
        return self

    async def __aexit__(self, *_error: object) -> None:
        await self.double.stop()
        for bench in self.benches:
            await bench.nck.stop()

    # ---- both at once -----------------------------------------------------------------------------

    def each(self, act: Callable[[Any], Any]) -> None:
        """Do something to both controls."""
        for bench in self.benches:
            act(bench.nck)

    async def pass_time(self, cycles: int, *, beating: bool = True) -> None:
        """Cycles of both PLCs; the PC's heart-beat goes on if it beats."""
        for _ in range(cycles):
            self._cycles += 1
            if beating and self._cycles % 40 == 0:
                self.beats = (self.beats + 1) & 0xFFFF
                self.double.write(15, [self.beats])
                self.text.registers[15] = self.beats
            await self.clock.sleep(SCAN_MS / 1000.0)
            self.text.cycle()

    async def pass_seconds(self, seconds: float, *, beating: bool = True) -> None:
        """So much time."""
        await self.pass_time(round(seconds * 1000.0 / SCAN_MS), beating=beating)

    def write(self, head: Sequence[int], data: Sequence[int], check: int) -> None:
        """The PC's requests: data, then the command with its CRC."""
        high, low = check >> 16, check & 0xFFFF
        words = [*head, *((low, high) if self.low_first else (high, low))]
        if data:
            self.double.write(36, list(data))
            self.text.registers[36:136] = data
        self.double.write(16, words)
        self.text.registers[16:36] = words

    def picture(self) -> tuple[dict[int, int], dict[int, int]]:
        """All registers that must agree: the double's, the text's."""
        found: dict[int, int] = dict(zip(range(15), self.double.read(0, 15), strict=True))
        for first, count in AREAS:
            found |= dict(zip(range(first, first + count), self.double.read(first, count), strict=True))
        for seconds in (4, 384):  # each counts its own
            found.pop(seconds)
        return found, {register: self.text.registers[register] for register in found}

    def difference(self) -> dict[int, tuple[int, int]]:
        """Registers that do not agree: the double's, the text's."""
        wanted, found = self.picture()
        return {register: (value, found[register]) for register, value in wanted.items() if value != found[register]}

    def states(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Status word and number of both."""
        status, number = self.double.read(5, 2)
        return (status, number), (self.text.registers[5], self.text.registers[6])

    async def until(self, number: int, bits: int) -> None:
        """Both have taken the number and show one of the bits."""
        for _ in range(TOO_LONG):
            if all(taken == number and status & bits for status, taken in self.states()):
                return
            await self.pass_time(1)
        raise AssertionError(f"command {number} does not come to {bits:#x}: {self.states()}")

    # ---- commands ---------------------------------------------------------------------------------

    def dint(self, value: int) -> list[int]:
        """A DINT in the plant's word order."""
        high, low = value >> 16 & 0xFFFF, value & 0xFFFF
        return [low, high] if self.low_first else [high, low]

    def named(self, code: int) -> list[int]:
        """A head that names a table: 18-20 and, for a cross table, 32."""
        kind = self.chance.choice((1, 1, 1, 2, 2, 2, 3, 4) if code in (READ, SELECT) else (1, 1, 1, 2, 2, 3))
        index = self.chance.randrange(3) if kind == 2 else self.chance.choice((1, 1, 2, 3, 3))
        head = [code, 0, kind, index, self.chance.randrange(2), *[0] * 13]
        if kind == 2:
            head[16] = self.chance.choice((1, 2, 3))
        return head

    def sound_begin(self) -> list[int]:
        """Command 2 as a PC would send it."""
        head = self.named(BEGIN)
        if head[2] == 3:
            head[12] = self.chance.choice((1, 1, 1, 1, 2))
            return head
        most = (30, 8, 0, 0, 70, 5)[2 * (head[3] - 1) + head[4]] if head[2] == 1 else (12, 55, 4)[head[3]]
        total = self.chance.randrange(2, max(most, 2) + 1)
        if self.chance.random() < 0.08:
            total = self.chance.choice((0, 1, most + 1, 5001, 0x8000, 0xFFFF))
        low, step = self.chance.randrange(-100_000, 100_000), self.chance.randrange(1, 30_000)
        over = self.chance.choice((0, 0, step - 1, self.chance.randrange(-1, step + 1)))
        head[5] = self.chance.choice((0, 1, 2, 4, 8) if head[2] == 2 else (0, 0, 1))
        head[6:12] = [*self.dint(low), *self.dint(step), *self.dint(low + step * (total - 1) + over)]
        head[12] = total
        if head[2] == 2:
            head[15], head[17] = self.chance.choice((1, 2, 3)), self.chance.choice((0, 0, 1, 3))
        return head

    def next_chunk(self, load: Load) -> tuple[list[int], list[int]]:
        """Command 3 as it goes on."""
        count = min(50, load.head[12] - load.stored, self.chance.choice((1, 7, 25, 50, 50)))
        values = [self.chance.randrange(-60_000, 60_000) for _ in range(count)]
        words = [word for value in values for word in self.dint(value)]
        head = [CHUNK, *load.head[1:]]
        head[13], head[14] = load.stored, count
        return head, words

    def chosen(self) -> tuple[list[int], list[int]]:
        """The next command: mostly one that makes sense."""
        chance, load = self.chance, self.load
        if not self.text.registers[14] and chance.random() < 0.8:
            return [OPEN, 0, 0, chance.randrange(1, 0x10000), *[0] * 14], []
        if load is not None and chance.random() < 0.8:
            if load.stored < load.head[12] and chance.random() < 0.94:
                return self.next_chunk(load)
            return [VERIFY, *load.head[1:]], []
        if load is not None and chance.random() < 0.3:
            if chance.random() < 0.5:
                return self.switching(ACTIVATE, [self.entry_of(load.head)])
            return [READ, *load.head[1:5], *[0] * 11, load.head[16], 0], []
        code = chance.choices(
            (OPEN, BEGIN, CHUNK, VERIFY, ACTIVATE, DISABLE, READ, ABORT, CLOSE, MARKER, SELECT),
            (2, 24, 2, 2, 16, 16, 14, 3, 3, 5, 12),
        )[0]
        if code == BEGIN:
            return self.sound_begin(), []
        if code in (ACTIVATE, DISABLE):
            return self.switching(
                code, [self.entry_of(self.named(BEGIN)) for _ in range(chance.choice((1, 1, 2, 3, 7)))]
            )
        head = self.named(code)
        if code == READ:
            head[13], head[14] = chance.choice((0, 0, 1, 3)), chance.choice((1, 2, 3, 5, 12, 50))
        words = [chance.randrange(0x3030, 0x3939) for _ in range(8)] + [chance.choice((0, 1, 2, 3, 3, 4))]
        words += [chance.randrange(0x10000) for _ in range(4)]
        return head, words if code == MARKER else [0] * 2 if code == CHUNK else []

    def entry_of(self, head: list[int]) -> list[int]:
        """A table as an entry of commands 5 and 6."""
        if head[2] == 2:
            return [2, head[3], head[4], head[16], self.chance.choice((0, 0, 0x10, 0x20))]
        return [head[2], head[3], head[4], head[3], 0]

    def switching(self, code: int, entries: list[list[int]]) -> tuple[list[int], list[int]]:
        """Command 5 or 6; now and then an entry is anything."""
        if self.chance.random() < 0.08:
            self.chance.choice(entries)[self.chance.randrange(5)] = self.chance.choice(ODD)
        flags = self.chance.choice((0, 0, 0, 0x40)) if code == DISABLE else self.chance.choice((0,) * 9 + (0x10,))
        head = [code, 0, 0, 0, 0, flags, *[0] * 12]
        head[14] = len(entries)
        return head, [word for entry in entries for word in entry]

    def spoiled(self, head: list[int]) -> None:
        """One or two registers are anything."""
        for _ in range(self.chance.choice((1, 1, 2))):
            head[self.chance.choice((2, 3, 4, 5, 7, 8, 9, 11, 12, 13, 14, 15, 16, 17))] = self.chance.choice(ODD)

    async def command(self) -> None:
        """One command from its writing to its end on both."""
        chance = self.chance
        if self.text.registers[14] and not self.double.release.counts and chance.random() < 0.6:
            await self.released()
        head, data = self.chosen()
        if chance.random() < 0.12:
            self.spoiled(head)
        if chance.random() < 0.02:
            head[0] = chance.choice((0, 12, 13, 300, 0xFFFF))
        taken = self.text.registers[6]
        head[1] = taken % 0xFFFF + 1
        if chance.random() < 0.03:
            head[1] = chance.choice((taken, head[1] % 0xFFFF + 1, 0, 0xFFFF))
        full = [*data, *[0] * (100 - len(data))] if head[0] in (CHUNK, MARKER, ACTIVATE, DISABLE) else []
        words = self.load.words if self.load else []
        check = crc([*head, *(words if head[0] == VERIFY else full)]) ^ (chance.random() < 0.02)
        self.write(head, full, check)
        if head[1] == taken:
            await self.pass_time(4)
            return
        await self.ended(head)
        self.keep(head, full)
        if head[0] in (ACTIVATE, DISABLE):
            await self.pass_seconds(0.2)  # the axes come to rest under what acts now

    async def ended(self, head: list[int]) -> None:
        """Until the end, with somebody at the panel where it is asked for."""
        await self.until(head[1], DONE | FAILED | WAITING)
        while self.text.registers[5] & WAITING:
            assert self.states()[0][0] & WAITING
            fate = self.chance.choices(list(self.fates), list(self.fates.values()))[0]
            if fate == "nobody":
                await self.pass_seconds(61.0)
            elif fate == "silence":
                await self.pass_seconds(6.0, beating=False)
            elif fate == "other":
                return await self.interrupted(head)
            else:
                if fate == "disturb":
                    self.happening()
                    self.double.write(36, [0] * 100)  # what was asked for stands, whatever comes after it
                    self.text.registers[36:136] = [0] * 100
                    await self.pass_time(2)
                self.double.confirm()
                self.text.plant.button = True
                await self.pass_time(LOOK)
                self.text.plant.button = False
            await self.until(head[1], DONE | FAILED | WAITING)
        return None

    async def interrupted(self, head: list[int]) -> None:
        """Another command comes while one waits."""
        other = self.named(self.chance.choice((ABORT, CLOSE, SELECT, READ, OPEN)))
        other[1] = head[1] % 0xFFFF + 1
        self.write(other, [], crc(other))
        await self.until(other[1], DONE | FAILED)
        head[:] = other

    def keep(self, head: list[int], data: list[int]) -> None:
        """What the PC remembers of a load."""
        done = self.text.registers[7] == 0
        if done and head[0] == BEGIN:
            self.load = Load(list(head))
        elif done and head[0] == CHUNK and self.load is not None:
            self.load.words += data[: 2 * head[14]]
            self.load.stored += head[14]
        elif not self.text.registers[14] or (done and head[0] in (VERIFY, ABORT, CLOSE)):
            self.load = None
        self.seen[head[0], self.text.registers[7]] += 1

    # ---- what else happens ------------------------------------------------------------------------

    def happening(self) -> None:
        """Something at the machine."""
        what = self.chance.choice(("key", "release", "alarm", "start"))
        if what == "key":
            level = self.chance.choice((4, 4, 7))
            self.each(lambda nck: nck.set_access_level(level))
        elif what == "release":
            self.release(self.chance.random() < 0.5)
        elif what == "alarm":
            self.each(lambda nck: nck.drive_alarm(ALARM, "coolant"))
        else:
            self.each(moving)

    def release(self, on: bool) -> None:
        """The switch at the panel."""
        self.double.release.set(on)
        self.text.plant.release = on

    async def released(self) -> None:
        """Somebody gives the release anew."""
        self.release(False)
        await self.pass_time(3)
        self.release(True)
        await self.pass_time(3)

    def calmed(self) -> None:
        """The machine is as before, the release taken back."""
        self.each(_calm)
        self.release(False)

    def hand_at_the_tables(self) -> None:
        """Somebody at the control writes what the mailbox cannot tell."""
        name, value = self.chance.choice(
            (("$AA_ENC_COMP[0,1,X1]", 5000.0), ("$AA_ENC_COMP_MIN[1,X1]", 0.123456789), ("$AN_CEC_STEP[1]", 1.0 / 3.0))
        )
        self.each(lambda nck: _written(nck, name, value))

    async def between(self) -> None:
        """Now and then something happens between two commands."""
        chance = self.chance.random()
        if chance < 0.06:
            self.happening()
        elif chance < 0.16:
            self.calmed()
        elif chance < 0.18:
            self.hand_at_the_tables()
        elif chance < 0.19:
            await self.pass_seconds(6.0, beating=False)
        elif chance < 0.2:
            self.power_cut()
        else:
            return
        await self.pass_seconds(0.5)

    def power_cut(self) -> None:
        """The PLC's mains."""
        self.double.power_off()
        self.double.power_on()
        self.text.power_cycle()
        self.load, self.beats = None, 0

    def memories(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """What survives power off in both controls."""
        first, second = (bench.nck.static_memory() for bench in self.benches)
        return first, second


def moving(nck: Any) -> None:
    """Somebody starts a program."""
    if nck.select(MAIN) == 0:
        nck.nc_start()


def _calm(nck: Any) -> None:
    nck.set_access_level(4)
    nck.channel_reset()
    nck.acknowledge_alarms()


def _written(nck: Any, name: str, value: float) -> None:
    try:
        nck.set(name, value, 0)
    except NckRefusal:
        return


def side_by_side(
    read: Library, seed: str, count: int, *, low_first: bool, fates: Mapping[str, int] = FATES, **spec: Any
) -> Counter[tuple[int, int]]:
    """So many commands, the text as it was read; how often each ended with which code.

    ``fates`` is what becomes of a command that waits for a confirmation. Raises AssertionError with what differs.
    """

    async def main() -> Counter[tuple[int, int]]:
        async with Pair(read, seed, low_first=low_first, **spec) as pair:
            pair.fates = dict(fates)
            for place in range(count):
                await pair.between()
                await pair.command()
                other = pair.difference()
                if other and set(other) <= RESTLESS:  # two axes do not come to rest at one instant
                    pair.later += 1
                    await pair.pass_seconds(0.5)
                    other = pair.difference()
                assert not other, f"{seed}, command {place} {pair.text.registers[16:34]}: {other} (double, text)"
            first, second = pair.memories()
            assert first == second
            return pair.seen

    return run_virtual(main)
