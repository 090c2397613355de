"""Pushes over OPC UA with faults drawn by a seed, each judged by what the machine then holds.

`played(seed, folder, keys)` is one push, the same each time but for what the operating system does to sockets.
"""

from __future__ import annotations

import asyncio
import random
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import run_virtual
from drivers.errors import TrueflankError
from gateway.push import push_table
from tests.push.disk import FAULTS, Disk, failing
from tests.push.judging import Played, ended, judge, settle, watching
from tests.push.schedules import JUMPS_S, JumpingClock, stop
from tests.push.uaworld import UaPerson, UaWorld, choice, ua_change, ua_context, ua_world

PATIENCE_S = 25.0
BLOCKS, REQUESTS = 440, 230
WHIMS = {"swaps_points_at_reset", "enables_again_s"}
Begin = Callable[[UaWorld, "Schedule", asyncio.Task[Any]], None]


@dataclass
class Schedule:
    """Everything drawn for one seed. ``at_block`` and ``at_request``: what happens at which, counted from 1."""

    rng: random.Random
    faults: list[str] = field(default_factory=list)
    switches: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    disk: Disk | None = None
    begin: list[Begin] = field(default_factory=list)
    at_block: dict[int, list[Callable[[], None]]] = field(default_factory=dict)
    at_request: dict[int, list[Callable[[], None]]] = field(default_factory=dict)

    def when(self, act: Callable[[UaWorld], None], what: str) -> None:
        """Let it happen at a block of some program, or at a request."""
        block = self.rng.random() < 0.5
        due, most = (self.at_block, BLOCKS) if block else (self.at_request, REQUESTS)
        number = self.rng.randrange(1, most)
        self.faults.append(f"{what} at {'block' if block else 'request'} {number}")
        self.begin.append(lambda at, _made, _task: due.setdefault(number, []).append(lambda: act(at)))


def drawn(seed: int) -> Schedule:
    """One to three faults for a seed."""
    made = Schedule(random.Random(seed))
    for _ in range(made.rng.choice((1, 1, 1, 2, 2, 3))):
        made.rng.choice(KINDS)(made)
    return made


def _machine(made: Schedule) -> None:
    acts: dict[str, Callable[[UaWorld], None]] = {
        "power cut": lambda at: at.nck.power_cycle(),
        "alarm": lambda at: at.nck.drive_alarm(300504, "drive fault"),
        "key": lambda at: at.nck.set_access_level(7),
        "mode": lambda at: at.nck.change_mode_by_hand(),
        "NCK reset": lambda at: at.nck.nck_reset(),
        "reset": lambda at: at.nck.channel_reset(),
        "reference lost": lambda at: at.nck.lose_reference("X1"),
    }
    name = made.rng.choice(list(acts))
    made.when(acts[name], name)


def _wire(made: Schedule) -> None:
    status = made.rng.choice(("BadNotConnected", "BadUserAccessDenied", "UncertainLastUsableValue", "BadNotWritable"))
    seconds = made.rng.uniform(2.0, 12.0)

    def manner(name: str, value: Any, honest: Any) -> Callable[[UaWorld], None]:
        async def later(at: UaWorld) -> None:
            setattr(at.server.quirks, name, value)
            await at.clock.sleep(seconds)
            setattr(at.server.quirks, name, honest)

        return lambda at: at.spawn(later(at))

    r_values = {f"/Channel/Parameter/R[{number}]": status for number in range(90, 100)}
    acts: dict[str, Callable[[UaWorld], None]] = {
        "dropped": lambda at: at.spawn(at.server.drop_connections()),
        "slow": manner("answer_s", made.rng.uniform(0.5, 8.0), 0.0),
        "late writes": manner("late_write_s", made.rng.uniform(1.0, 8.0), 0.0),
        f"writes {status}": manner("write_status", r_values, {}),
        "stale": manner("stale_s", 30.0, 0.0),
        "quantised": manner("quantise", lambda value: round(value, 0), None),
    }
    name = made.rng.choice(list(acts))
    made.when(acts[name], f"wire {name}")


def _nck(made: Schedule) -> None:
    rng = made.rng
    option: dict[str, Any] = rng.choice(
        (
            {"activation": "newconf"},
            {"activation": "power_on"},
            {"float32_tables": True},
            {"accepts_nan": True, "accepts_points_beyond": True},
            {"loses_last_points": rng.choice((1, 2))},
            {"writes_late_s": rng.uniform(0.05, 3.0)},
            {"lies_about_disable": True},
            {"ignores_newconf": True},
            {"enable_cleared_at_boot": True},
            {"stale_files": True},
            {"system_reads_stop": True, "preprocess_ahead": rng.choice((0, 3, 20))},
            {"r_writable": False},
        )
    )
    if rng.random() < 0.15:
        option, made.settings = {"fetch_while_waiting": False}, {"two_programs": True}
    made.faults.append(f"NCK {option}")
    made.switches |= option


def _whim(made: Schedule) -> None:
    """The control does something by itself."""
    rng = made.rng
    kind, what = rng.choice(("swap", "enable", "enable", "twice", "forget")), rng.choice(("words", "memory", "switch"))
    if kind in ("swap", "twice"):
        twice = {"enables_again_s": rng.uniform(0.5, 60.0)}
        option: dict[str, Any] = {"swaps_points_at_reset": rng.randrange(10)} if kind == "swap" else twice
        made.faults.append(f"whim {option}")
        made.switches |= option
        return
    act: Callable[[UaWorld], None] = lambda at: at.nck.enable_by_itself()  # noqa: E731
    if kind == "forget":
        act = lambda at: at.nck.forget(what)  # noqa: E731
    made.when(act, f"whim {kind} {what if kind == 'forget' else ''}")


def _hand(made: Schedule) -> None:
    """Somebody at the HMI writes a point; what is enabled the control itself protects."""
    number, value = made.rng.randrange(12), made.rng.uniform(-0.02, 0.02)

    def act(at: UaWorld) -> None:
        if at.nck.booting or at.oracle.switched_on or at.oracle.acts:
            return
        at.oracle.foreign = True
        at.nck.set(f"$AA_ENC_COMP[0,{number},X1]", value, 0)

    made.when(act, "hand")


def _person(made: Schedule) -> None:
    kind = made.rng.choice(("starts", "restarts", "resets", "after_s"))
    made.faults.append(f"person without {kind}")
    made.begin.append(lambda at, _made, _task: setattr(at.person, kind, 3.0 if kind == "after_s" else False))


def _disk(made: Schedule) -> None:
    made.disk = Disk(made.rng.choice(FAULTS), made.rng.randrange(1, 12))
    made.faults.append(f"disk {made.disk.kind} at entry {made.disk.nth}")


def _calendar(made: Schedule) -> None:
    seconds = made.rng.choice(JUMPS_S)

    def act(at: UaWorld) -> None:
        assert isinstance(at.clock, JumpingClock)
        at.clock.ahead_s += seconds

    made.when(act, f"clock {seconds:+} s")


def _stopped(made: Schedule) -> None:
    number = made.rng.randrange(1, REQUESTS)
    made.faults.append(f"stopped at request {number}")

    def begin(_at: UaWorld, due: Schedule, task: asyncio.Task[Any]) -> None:
        due.at_request.setdefault(number, []).append(lambda: stop(task))

    made.begin.append(begin)


KINDS: tuple[Callable[[Schedule], None], ...] = (
    _machine, _machine, _machine, _wire, _wire, _wire, _nck, _hand, _person, _disk, _calendar, _stopped,
    _whim, _whim,
)  # fmt: skip


def played(seed: int, folder: Path, keys: Path) -> Played:
    """The push of a seed, and the recovery of what it left, judged."""
    made = drawn(seed)
    found = Played(seed, made.faults)
    folder.mkdir(parents=True)

    async def main() -> None:
        clock = JumpingClock()
        async with ua_world(clock, keys, choice(made.rng), **made.switches) as at:
            await _play(made, at, folder, found)

    run_virtual(main)
    return found


async def _play(made: Schedule, at: UaWorld, folder: Path, found: Played) -> None:
    device = watching(at.driver(**made.settings), at.oracle)
    await device.open(5.0)
    try:
        base = await at.base(device)
        at.oracle.writes = 0
    except TrueflankError as error:  # a control that cannot even save its tables gets no push
        found.outcome, found.recovered = f"no base: {type(error).__name__}", "nothing open"
        await device.close()
        return
    said: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        at.oracle.backed_up = at.oracle.backed_up or fields.get("step") == "BACKUP"
        at.person.hear(code, fields)

    machine = await device.identify()
    more: dict[str, Any] = {"say": say, "start_timeout_s": PATIENCE_S, "stop_timeout_s": PATIENCE_S}
    context = ua_context(device, at.clock, folder, machine, **more)
    with failing(made.disk):
        task = asyncio.ensure_future(ended(push_table(ua_change(base, at.new), context)))
        _arm(made, at, task)
        found.outcome = await task
    at.nck.on_block, at.server.quirks.on_request = None, lambda _service: None
    await device.close()
    judge(at.oracle, found, said, context)
    found.whims = list(at.oracle.whims)
    await _mended(at, off_and_on=made.rng.random() < 0.3)
    fresh = at.driver(**made.settings)
    await fresh.open(5.0)
    try:
        context = replace(context, controller=fresh, start_timeout_s=60.0)
        await settle(at.oracle, context, found, willing=not set(made.switches) - WHIMS)
    finally:
        await fresh.close()


def _arm(made: Schedule, at: UaWorld, task: asyncio.Task[Any]) -> None:
    counts = {"block": 0, "request": 0}

    def step(kind: str, due: dict[int, list[Callable[[], None]]]) -> None:
        counts[kind] += 1
        for act in due.pop(counts[kind], []):
            act()

    for begin in made.begin:
        begin(at, made, task)
    at.nck.on_block = lambda _block: step("block", made.at_block)
    at.server.quirks.on_request = lambda _service: step("request", made.at_request)


async def _mended(at: UaWorld, *, off_and_on: bool) -> None:
    """Everything is put right again: server, key, alarms, person; what waits is reset, or all switched off and on."""
    at.person = UaPerson()
    at.nck.core.spec = replace(at.nck.core.spec, swaps_points_at_reset=None, enables_again_s=0.0)
    await at.clock.sleep(20.0)
    at.nck.set_access_level(2)
    await at.ready()
    at.nck.channel_reset()
    await at.clock.sleep(2.0)
    if off_and_on or at.nck.alarms:
        at.nck.power_cycle()
    await at.ready()


if __name__ == "__main__":
    for word in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as scratch:
            print(played(int(word), Path(scratch) / "push", Path(scratch)))
