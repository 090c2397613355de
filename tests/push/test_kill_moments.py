"""SIGKILL of a real process at a seeded moment of its push: what the control's memory is then, and after `recover`.

The machine lives in this process by the clock of the wall, a little faster, and goes on; the gateway is a fresh Python
that reads, writes and syncs as on a shop floor. The moment is drawn over the time that an undisturbed push takes, from
its begin to a little past its end, so that nothing decides where the kill hits: not a step, not a call.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import signal
import sys
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.types.tables import LiveTable
from gateway.push import journal
from gateway.push.recovery import unfinished_tables
from tests import attacks
from tests.push.judging import Played, settle
from tests.push.uagateway import BEGUN, ENDED
from tests.push.uaworld import ua_context, ua_world
from tests.push.world import OLD, Scene, context_for, world
from tests.sizes import few

pytestmark = [
    pytest.mark.attack,
    pytest.mark.skipif(sys.platform == "win32", reason="a process that is killed here is ended by a signal"),
]

ROADS = {"OPC UA": 20.0, "mailbox": 8.0}
"""How many times faster than the wall the machine lives."""
LAPSED_S = 6.0
"""The PLC ends a session of which it hears nothing for 5 s of the PC's clock."""
STARTS = 4
RECOVERIES = 3
"""By the clock of the wall a crowded computer may be late; a recovery that is held is repeated, as its text says."""
EACH = 5
SHARDS = 20
PAST = 1.1


@dataclass
class Place:
    """A machine on one road, and how a gateway reaches it."""

    at: Any
    url: str
    clock: LoopClock

    async def after_the_kill(self) -> None:
        """The PLC ends the lost session; a person resets the program that waits."""
        await self.clock.sleep(LAPSED_S * self.clock.speed)
        if hasattr(self.at, "server"):
            self.at.nck.channel_reset()
            await self.clock.sleep(1.0)
        await self.at.ready()

    async def recover(self, root: Path, found: Played) -> None:
        """A fresh gateway looks and leads home."""
        device = self.at.driver() if hasattr(self.at, "server") else self.at.driver(reply_s=30.0, command_s=600.0)
        await device.open(900.0)
        try:
            more: dict[str, Any] = {"start_timeout_s": 900.0, "say": lambda code, /, **f: self.at.person.hear(code, f)}
            machine = await device.identify()
            if hasattr(self.at, "server"):
                context = ua_context(device, self.clock, root, machine, **more)
            else:
                context = context_for(Scene(), device, self.clock, root, machine, **more)
            await settle(self.at.oracle, context, found, willing=False)
        finally:
            await device.close()


@contextlib.asynccontextmanager
async def place(road: str, keys: Path) -> AsyncIterator[Place]:
    """A machine with the old table on."""
    clock = LoopClock(ROADS[road])
    if road == "OPC UA":
        async with ua_world(clock, keys, LiveTable(OLD, True)) as at:
            yield Place(at, at.server.url, clock)
    else:
        async with world(Scene(), clock, url="tcp://127.0.0.1:0") as plc:
            yield Place(plc, plc.station.home, clock)


async def pushed(where: Place, root: Path, road: str, kill_after_s: float | None) -> tuple[int, str, float]:
    """A fresh process pushes; (its return code, its last line, seconds by the wall from its begin to its end).

    One that a crowded computer lets not even connect in time is started again: nothing was pushed yet.
    """
    root.mkdir()  # noqa: ASYNC240 - nothing else runs
    for _ in range(STARTS):
        found = await _pushed(where, root, road, kill_after_s)
        if found is not None:
            return found
    raise AssertionError(f"no push began in {STARTS} processes")


async def _pushed(where: Place, root: Path, road: str, kill_after_s: float | None) -> tuple[int, str, float] | None:
    """One process; None where it ended before its push began."""
    words = ["-m", "tests.push.uagateway", where.url, str(root), str(ROADS[road]), "-1"]
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE)
    begun, over, last, wall = 0.0, 0.0, "", LoopClock()

    async def reap() -> None:
        await wall.sleep(kill_after_s or 0.0)
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGKILL)

    reaper: asyncio.Task[None] | None = None
    assert process.stdout is not None
    while line := (await process.stdout.readline()).decode().strip():
        if line == BEGUN:
            begun = time.perf_counter()
            reaper = asyncio.create_task(reap()) if kill_after_s is not None else None
        elif line == ENDED:
            over = time.perf_counter()
        elif line.startswith('{"say"'):
            told = json.loads(line)
            where.at.person.hear(told["say"], told["fields"])
        else:
            last = line
    code = await process.wait()
    took = (over or time.perf_counter()) - begun
    if reaper is not None:
        reaper.cancel()
        await asyncio.gather(reaper, return_exceptions=True)
    return (code, last, took) if begun else None


def outcome_of(journals: Path, serial: str) -> str:
    """What a process that had time to end left as its last word; "killed" where it had none."""
    folder = journal.machine_folder(journals, serial)
    kept = [
        one.kinds[-1] for one in (*journal.read_journals(folder / "done"), *journal.read_journals(folder)) if one.kinds
    ]
    return "committed" if kept[-1:] == ["COMMITTED"] and not unfinished_tables(journals, serial) else "killed"


def killed(root: Path, keys: Path, road: str, after_s: float) -> Played:
    """One kill, judged by the control's memory before and after the recovery."""

    async def main() -> Played:
        async with place(road, keys) as where:
            code, last, _took = await pushed(where, root, road, after_s)  # 1: it had ended with an error by itself
            oracle = where.at.oracle
            await where.after_the_kill()
            oracle.look("after the kill")
            found = Played(0, [f"killed after {after_s:.3f} s"])
            found.wrong += [] if code in (0, 1, -signal.SIGKILL) else [f"the process ended with {code}: {last}"]
            serial = where.at.nck.spec.serial
            found.outcome = outcome_of(root / "journal", serial)
            if found.outcome == "committed" and not oracle.as_wanted:
                found.wrong.append("committed, says the journal, but the new table is not on")
            for _ in range(RECOVERIES):
                await where.recover(root, found)
                if not unfinished_tables(root / "journal", serial):
                    break
            oracle.look("after recovery")
            if not (oracle.as_before or oracle.as_wanted):
                found.wrong.append("neither as before nor as wanted after the recovery")
            if unfinished_tables(root / "journal", serial):
                found.wrong.append("recovery has not ended it")
            found.wrong += [words for words in oracle.broken if words not in found.wrong]
            return found

    return asyncio.run(main())


@pytest.fixture(scope="module")
def lengths(tmp_path_factory: pytest.TempPathFactory, keys: Path) -> dict[str, float]:
    """How long a push takes that nobody kills, by road."""
    found = {}
    for road in ROADS:

        async def main(road: str = road) -> float:
            async with place(road, keys) as where:
                root = tmp_path_factory.mktemp("length") / "push"
                code, last, took = await pushed(where, root, road, None)
                assert code == 0
                assert json.loads(last)["outcome"] == "committed"
                assert where.at.oracle.as_wanted
                return took

        found[road] = asyncio.run(main())
    return found


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", few(range(SHARDS), 0, 1))
@pytest.mark.parametrize("road", list(ROADS))
def test_killed_at_seeded_moments(tmp_path: Path, keys: Path, lengths: dict[str, float], road: str, shard: int) -> None:
    """Two hundred in all with `make soak`; ten with `make long`."""
    rng = random.Random(f"{road} {shard}")
    moments = [rng.uniform(0.0, PAST * lengths[road]) for _ in range(EACH)]
    found = [killed(tmp_path / str(n), keys, road, after_s) for n, after_s in enumerate(moments)]
    print(
        road,
        f"{lengths[road]:.2f} s",
        [(f"{m:.2f}", one.outcome, one.recovered) for m, one in zip(moments, found, strict=True)],
    )
    attacks.judged("kill -9 of a real process at a seeded moment, by the clock", road, (one.wrong for one in found))
    assert [str(one) for one in found if one.wrong] == []
