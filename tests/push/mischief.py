"""What goes wrong on the wire between gateway and PLC: at one request or command, seeded, the same each time."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.clock import Clock
from drivers.errors import TransportError
from drivers.transport import ByteTransport

COMMANDS = {2: "BEGIN", 3: "CHUNK", 4: "VERIFY", 5: "ACTIVATE", 6: "DISABLE", 10: "MARKER"}
LIES = ("bit", "exception", "transaction", "unit", "function", "short", "garbage")
EXCEPTIONS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 11)


@dataclass(frozen=True)
class Moment:
    """The nth request, or the nth writing of a command."""

    nth: int
    command: str = ""


@dataclass
class Mischief:
    """Faults of one wire; a cut wire may be opened again, and is then sound."""

    clock: Clock
    rng: random.Random
    due: list[tuple[Moment, Callable[[], None]]] = field(default_factory=list)
    requests: int = 0
    seen: dict[str, int] = field(default_factory=dict)
    cut_after: int = 0
    passed: int = 0
    late_s: float = 0.0
    repeats: int = 1
    lie: str = ""
    lost: bool = False
    damage: bool = False

    def around(self, wire: ByteTransport) -> ByteTransport:
        """The PLC's end of a connection with these faults."""
        return _Bad(wire, self)

    def asked(self, data: bytes) -> bytes:
        """A request arrives: what is due at it happens first."""
        self.requests += 1
        self._count(data)
        for moment, act in list(self.due):
            reached = self.seen.get(moment.command, 0) if moment.command else self.requests
            if reached >= moment.nth:
                self.due.remove((moment, act))
                act()
        if self.damage:
            self.damage = False
            return self._bit(data)
        return data

    def _count(self, data: bytes) -> None:
        if len(data) >= 15 and data[7] == 16 and data[8:10] == b"\0\x10":
            name = COMMANDS.get(int.from_bytes(data[13:15], "big"), "")
            self.seen[name] = self.seen.get(name, 0) + 1

    def answered(self, data: bytes) -> list[bytes]:
        """What of an answer goes out."""
        if self.lost:
            self.lost = False
            return []
        if self.lie:
            kind, self.lie = self.lie, ""
            data = self._lied(kind, data)
        found, self.repeats = [data] * self.repeats, 1
        return found

    def _lied(self, kind: str, data: bytes) -> bytes:
        """An answer of Modbus TCP that is wrong in one way."""
        if kind == "exception":
            return data[:4] + b"\0\3" + data[6:7] + bytes((data[7] | 0x80, self.rng.choice(EXCEPTIONS)))
        if kind == "garbage":
            return self.rng.randbytes(9) + data
        if kind == "short":
            return data[: self.rng.randrange(1, len(data))]
        place = {"transaction": self.rng.randrange(2), "unit": 6, "function": 7}.get(kind)
        return self._bit(data) if place is None else self._flipped(data, place)

    def _bit(self, data: bytes) -> bytes:
        return self._flipped(data, self.rng.randrange(len(data)))

    def _flipped(self, data: bytes, place: int) -> bytes:
        bad = bytearray(data)
        bad[place] ^= 1 << self.rng.randrange(8)
        return bytes(bad)

    def passes(self, data: bytes) -> bytes:
        """What of these bytes still passes a wire that is cut after so many. Raises TransportError when none does."""
        if not self.cut_after:
            return data
        room = self.cut_after - self.passed
        self.passed += len(data)
        if len(data) <= room:
            return data
        self.cut_after = 0
        raise _Cut(data[: max(room, 0)])


class _Cut(Exception):
    """The wire is cut; ``args[0]`` has passed."""


class _Bad:
    """A wire with faults, seen from the PLC."""

    def __init__(self, inner: ByteTransport, mischief: Mischief) -> None:
        self._inner, self._mischief = inner, mischief

    @property
    def description(self) -> str:
        """The inner wire's."""
        return self._inner.description

    async def read(self, max_bytes: int) -> bytes:
        """A request, perhaps damaged."""
        data = await self._inner.read(max_bytes)
        try:
            return self._mischief.passes(self._mischief.asked(data))
        except _Cut as cut:
            raise await self._gone() from cut

    async def write(self, data: bytes) -> None:
        """An answer, perhaps late, twice, wrong, in part or not at all."""
        late_s, self._mischief.late_s = self._mischief.late_s, 0.0
        if late_s:
            await self._mischief.clock.sleep(late_s)
        for piece in self._mischief.answered(data):
            try:
                await self._inner.write(self._mischief.passes(piece))
            except _Cut as cut:
                if cut.args[0]:
                    await self._inner.write(cut.args[0])
                raise await self._gone() from cut

    async def _gone(self) -> TransportError:
        await self._inner.close()
        return TransportError("E-LINK-CLOSED", self.description, why="the wire is cut")

    async def close(self) -> None:
        """Close the inner wire."""
        await self._inner.close()
