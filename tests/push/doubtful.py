"""Whole pushes over OPC UA whose saved files reach the gateway changed, each judged by what the machine then holds.

`played(seed, ...)` is one push, the same each time. The control writes honestly; what is fetched of one or two of its
files, at their nth fetching, has lines left out, doubled or exchanged, is another run's, or says another number.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from gateway.push import push_table
from tests.push.judging import Played, ended, judge, settle
from tests.push.uaworld import CROSS, Z_AXIS, UaPerson, UaWorld, choice, ua_change, ua_context, ua_world
from tests.push.world import NEW

_FILE = re.compile(r"/_N_SPF_DIR/_N_TF(LIVE|BACK|READ)_X1_SPF")
_MARK = re.compile(r"(;TRUEFLANK (?:END )?[A-Z]+ )(\d+)")
_NUMBER = re.compile(r"=(-?\d+(?:\.\d+)?)$")
Change = Callable[[list[str], random.Random], list[str]]


def left_out(lines: list[str], rng: random.Random) -> list[str]:
    """One line."""
    place = rng.randrange(len(lines))
    return [*lines[:place], *lines[place + 1 :]]


def run_left_out(lines: list[str], rng: random.Random) -> list[str]:
    """Several lines in a row."""
    first = rng.randrange(len(lines))
    return [*lines[:first], *lines[first + rng.randrange(2, len(lines)) :]]


def doubled(lines: list[str], rng: random.Random) -> list[str]:
    """One line."""
    place = rng.randrange(len(lines))
    return [*lines[:place], lines[place], *lines[place:]]


def exchanged(lines: list[str], rng: random.Random) -> list[str]:
    """Two lines."""
    one, two = rng.sample(range(len(lines)), 2)
    changed = list(lines)
    changed[one], changed[two] = lines[two], lines[one]
    return changed


def older(lines: list[str], rng: random.Random) -> list[str]:
    """The file of another run, with other values or with the same."""
    earlier = [_MARK.sub(lambda found: f"{found[1]}{int(found[2]) - 1}", line) for line in lines]
    return numbered(earlier, rng) if rng.random() < 0.5 else earlier


def numbered(lines: list[str], rng: random.Random) -> list[str]:
    """Another number in one line; a switch says the opposite."""
    places = [place for place, line in enumerate(lines) if _NUMBER.search(line)]
    place = rng.choice(places)
    name, value = lines[place].split("=")
    switch = "ENABLE" in name or "MODULO" in name
    other = str(1 - int(value)) if switch else f"{float(value) + rng.choice((-1, 1)) * rng.choice((0.0005, 0.01)):.7f}"
    return [*lines[:place], f"{name}={other}", *lines[place + 1 :]]


def without_switch(lines: list[str], _rng: random.Random) -> list[str]:
    """The switches of the axis."""
    return [line for line in lines if not line.startswith(("$MA_ENC_COMP_ENABLE", "$MA_CEC_ENABLE"))]


SHAPES: tuple[Change, ...] = (left_out, run_left_out, doubled, exchanged, older)


@dataclass(frozen=True)
class Attack:
    """The ``nth`` fetching of a section gives the file changed; 0: every one from the first of the push on."""

    section: str
    nth: int
    change: Change

    def __str__(self) -> str:
        return f"{self.section} {self.change.__name__} at fetch {self.nth or 'every'}"


@dataclass
class Wire:
    """What is read of files from outside goes through here. ``seen`` counts fetchings by section."""

    rng: random.Random
    attacks: tuple[Attack, ...]
    armed: bool = False
    seen: dict[str, int] = field(default_factory=dict)

    def around(self, at: UaWorld) -> None:
        """From now on; the control itself is not touched."""
        real = at.nck.files.read

        def read(path: str) -> bytes:
            return self.passed(path, real(path))

        at.nck.files.read = read  # type: ignore[method-assign]

    def passed(self, path: str, data: bytes) -> bytes:
        """What arrives of a file."""
        match = _FILE.fullmatch(path.upper())
        if match is None or not self.armed:
            return data
        number = self.seen[match[1]] = self.seen.get(match[1], 0) + 1
        for one in self.attacks:
            if one.section == match[1] and one.nth in (0, number):
                data = "\n".join([*one.change(data.decode().splitlines(), self.rng), ""]).encode()
        return data


def drawn(rng: random.Random) -> tuple[Attack, ...]:
    """One file attacked; a back-up only matters when the push fails, so then its read-back says a wrong number."""
    section = rng.choice(("LIVE", "LIVE", "BACK", "BACK", "READ"))
    change = numbered if rng.random() < 0.3 else rng.choice(SHAPES)
    first = Attack(section, rng.choice((0, 1, 1, 2, 3) if section == "LIVE" else (0, 1, 2)), change)
    if section == "BACK" and rng.random() < 0.7:
        return first, Attack("READ", 1, numbered)
    return (first,)


def played(seed: int, folder: Path, keys: Path) -> Played:
    """The push of a seed, and the recovery of what it left, judged."""
    rng = random.Random(seed)
    cross = rng.random() < 0.4
    return attacked(seed, drawn(rng), folder, keys, cross=cross)


def attacked(seed: int, attacks: tuple[Attack, ...], folder: Path, keys: Path, *, cross: bool = False) -> Played:
    """A push with these attacks, and the recovery of what it left, judged."""
    rng = random.Random(seed)
    wire = Wire(rng, attacks)
    told = [str(one) for one in wire.attacks]
    found = Played(seed, [*told, "cross" if cross else "axis"])
    folder.mkdir(parents=True)
    old, new = CROSS.tables if cross else (choice(rng), NEW)

    async def main() -> None:
        async with ua_world(LoopClock(), keys, old, new, activation="newconf") as at:
            await _play(at, wire, folder, found)

    run_virtual(main)
    return found


async def _play(at: UaWorld, wire: Wire, folder: Path, found: Played) -> None:
    device = at.driver(poll_s=1.0)
    await device.open(5.0)
    base = await at.base(device)
    wire.around(at)
    at.oracle.writes = 0
    said: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        at.person.hear(code, fields)

    machine = await device.identify()
    more: dict[str, Any] = {"input": Z_AXIS} if at.new.kind == "cross" else {}
    context = ua_context(device, at.clock, folder, machine, say=say, start_timeout_s=25.0, stop_timeout_s=25.0, **more)
    wire.armed = True
    found.outcome = await ended(push_table(ua_change(base, at.new), context))
    wire.armed = False
    await device.close()
    judge(at.oracle, found, said, context)
    if found.outcome == "already-applied" and not at.oracle.as_wanted:
        found.wrong.append("already applied, but the new table does not act")
    at.person = UaPerson()
    at.nck.channel_reset()
    await at.clock.sleep(2.0)
    await at.ready()
    fresh = at.driver(poll_s=1.0)
    await fresh.open(5.0)
    try:
        await settle(at.oracle, replace(context, controller=fresh, start_timeout_s=60.0), found, willing=False)
    finally:
        await fresh.close()


if __name__ == "__main__":
    for word in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as scratch:
            print(played(int(word), Path(scratch) / "push", Path(scratch)))
