"""Pushes through the mailbox with faults drawn by a seed, each judged by what the machine then holds.

`played(seed, folder)` is one push, the same each time: replay a failure with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import random
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from gateway.push import push_table
from simulators.nck import NckRefusal
from tests.push.disk import FAULTS, Disk, failing
from tests.push.judging import Played, ended, judge, settle, watching
from tests.push.mischief import COMMANDS, LIES, Mischief, Moment
from tests.push.world import Scene, World, change_of, context_for, world

PATIENCE_S = 12.0
JUMPS_S = (3600.0, -3600.0, 365.0 * 86400.0, -365.0 * 86400.0, 0.5)
HONEST: dict[str, Any] = {
    "busy_forever": 0, "wrong_read_back_crc": False, "late_command": 0, "redo_repeats": False, "careless": False,
    "lies_about_disable": False, "float32_values": False, "quantum_points": 0, "accepts_wrong_length": False,
    "lose_points": 0, "key_back": False, "alarm_during": 0, "power_cut_after": 0, "overwrites": (),
    "second_master": 0, "nck_refuses": 0, "confirm_dead": False, "swap_words": False, "swap_data_words": False,
    "map_version": 3, "stale_heartbeat": False, "enables_itself": 0, "enables_twice_s": 0.0, "forgets": 0,
}  # fmt: skip


class JumpingClock(LoopClock):
    """A clock whose calendar is set forward or back; its seconds go on as ever."""

    ahead_s = 0.0

    def utc(self) -> datetime:
        """What the wall says."""
        return super().utc() + timedelta(seconds=self.ahead_s)


@dataclass
class Schedule:
    """Everything drawn for one seed."""

    rng: random.Random
    faults: list[str] = field(default_factory=list)
    scene: Scene = field(default_factory=Scene)
    disk: Disk | None = None
    late: list[Callable[[World, Mischief, asyncio.Task[Any]], None]] = field(default_factory=list)

    def moment(self) -> Moment:
        """When: at a command of the transfer, or anywhere."""
        if self.rng.random() < 0.6:
            return Moment(1, self.rng.choice([*COMMANDS.values()]))
        return Moment(int(2 ** self.rng.uniform(3.0, 9.5)))


def drawn(seed: int) -> Schedule:
    """One to three faults and a machine for a seed."""
    rng = random.Random(seed)
    made = Schedule(rng)
    kind = rng.random()
    cross, never = kind < 0.15, 0.15 <= kind < 0.3
    made.scene = Scene(
        cross=cross,
        never=never,
        old_on=rng.random() < 0.8,
        strict=rng.random() < 0.25,
        sign=rng.choice((1, -1)) if cross else 1,
        plc={"scan_s": rng.choice((0.0, 0.0, 0.01, 0.05))},
    )
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3))):
        rng.choice(KINDS)(made)
    return made


# ---- kinds of faults -------------------------------------------------------------------------------


def _wire(made: Schedule) -> None:
    """One fault on the wire at one moment."""
    moment, rng = made.moment(), made.rng
    kind = rng.choice(("cut", "late", "twice", "lie", "lie", "lost", "damage", "black hole", "pulled"))
    lie, seconds, count = rng.choice(LIES), rng.uniform(0.3, 4.0), rng.randrange(1, 400)
    made.faults.append(f"wire {kind} {lie if kind == 'lie' else ''} at {moment}")

    def begin(at: World, bad: Mischief, _task: asyncio.Task[Any]) -> None:
        def act() -> None:
            if kind == "cut":
                bad.passed, bad.cut_after = 0, count
            elif kind == "late":
                bad.late_s = seconds
            elif kind == "twice":
                bad.repeats = 2
            elif kind == "lie":
                bad.lie = lie
            elif kind == "lost":
                bad.lost = True
            elif kind == "damage":
                bad.damage = True
            else:
                at.spawn(_dark(at, seconds * 3.0, pulled=kind == "pulled"))

        bad.due.append((moment, act))

    made.late.append(begin)


async def _dark(at: World, seconds: float, *, pulled: bool) -> None:
    """The PLC cannot be reached for a while."""
    if pulled:
        await at.station.pull()
    at.station.silent = True
    await at.clock.sleep(seconds)
    at.station.silent = False
    if pulled and not at.station.url:
        await at.station.plug(at.station.home)


def _plc(made: Schedule) -> None:
    """A PLC that misbehaves from one moment on."""
    rng, moment = made.rng, made.moment()
    command = rng.choice((2, 3, 4, 5, 6, 10))
    option = rng.choice(
        (
            {"busy_forever": command},
            {"wrong_read_back_crc": True},
            {"late_command": command, "late_s": rng.uniform(0.5, 6.0)},
            {"redo_repeats": True},
            {"lies_about_disable": True},
            {"float32_values": True},
            {"quantum_points": rng.choice((10, 500))},
            {"accepts_wrong_length": True, "lose_points": rng.choice((1, 3))},
            {"lose_points": rng.choice((1, 5)), "careless": True},
            {"key_back": True},
            {"alarm_during": command},
            {"power_cut_after": rng.randrange(1, 12)},
            {"overwrites": ((rng.choice((18, 22, 24, 26, 28, 40, 45, 130)), rng.randrange(65536)),)},
            {"second_master": rng.randrange(3, 60)},
            {"nck_refuses": command, "nck_result": rng.choice((3, 5, 9))},
            {"confirm_dead": True},
            {"swap_words": True},
            {"swap_data_words": True},
            {"map_version": 2},
            {"stale_heartbeat": True},
        )
    )
    made.faults.append(f"PLC {option} from {moment}")
    made.late.append(lambda at, bad, _task: bad.due.append((moment, lambda: at.station.plc.change(**option))))


def _nck(made: Schedule) -> None:
    """A control that misbehaves from the start."""
    rng = made.rng
    option = rng.choice(
        (
            {"float32_tables": True},
            {"accepts_nan": True, "accepts_points_beyond": True},
            {"loses_last_points": rng.choice((1, 2))},
            {"writes_late_s": rng.uniform(0.05, 3.0)},
            {"lies_about_disable": True},
            {"ignores_newconf": True},
            {"enable_cleared_at_boot": True},
            {"locked_alarm": 17180},
        )
    )
    made.faults.append(f"NCK {option}")
    made.scene = dataclasses.replace(made.scene, nck={**made.scene.nck, **option})


def _machine(made: Schedule) -> None:
    """Something happens at the machine at one moment."""
    rng, moment = made.rng, made.moment()
    kind = rng.choice(("key", "alarm", "mode", "nck reset", "power", "reference", "moved", "hand"))
    place, value = rng.randrange(12), rng.uniform(-0.02, 0.02)
    made.faults.append(f"machine {kind} at {moment}")

    def begin(at: World, bad: Mischief, _task: asyncio.Task[Any]) -> None:
        def act() -> None:
            nck = at.nck
            if kind == "key":
                at.station.plc.withdraw_release()
            elif kind == "alarm":
                nck.drive_alarm(300504, "drive fault")
            elif kind == "mode":
                nck.change_mode_by_hand()
            elif kind == "nck reset":
                nck.nck_reset()
            elif kind == "power":
                at.spawn(at.station.power_cycle())
            elif kind == "reference":
                nck.lose_reference("X1")
            elif kind == "moved":
                at.person.wishes.append(("X1", 37.0))
            else:
                _foreign(made, at, place, value)

        bad.due.append((moment, act))

    made.late.append(begin)


def _foreign(made: Schedule, at: World, place: int, value: float) -> None:
    """Somebody at the HMI writes a point; what is enabled the control itself protects."""
    name = f"$AN_CEC[0,{place}]" if made.scene.cross else f"$AA_ENC_COMP[0,{place},X1]"
    with contextlib.suppress(NckRefusal):
        at.nck.set(name, value, 0)
        at.oracle.foreign = True


def _whim(made: Schedule) -> None:
    """The control, or its PLC, does something by itself: at a reset, a command, or anywhere."""
    rng, moment = made.rng, made.moment()
    kind = rng.choice(("swap", "enable", "enable at a command", "twice", "forget", "forget at a command"))
    what = rng.choice(("words", "memory", "switch"))
    plc: dict[str, Any] = {
        "enable at a command": {"enables_itself": rng.choice((2, 3, 4, 6, 10))},
        "twice": {"enables_twice_s": rng.uniform(0.5, 20.0)},
        "forget at a command": {"forgets": rng.choice((2, 3, 4, 5, 6, 10)), "forgets_what": what},
    }.get(kind, {})
    made.faults.append(f"whim {kind} {plc or what if kind != 'swap' else 'and NCK reset'} at {moment}")
    if kind == "swap":
        made.scene = dataclasses.replace(made.scene, nck={**made.scene.nck, "swaps_points_at_reset": rng.randrange(10)})
    acts: dict[str, Callable[[World], None]] = {
        "swap": lambda at: None if at.scene.strict else at.nck.nck_reset(),
        "enable": lambda at: at.nck.enable_by_itself(),
        "forget": lambda at: at.station.plc.forget(what),
    }
    act = acts.get(kind, lambda at: at.station.plc.change(**plc))
    made.late.append(lambda at, bad, _task: bad.due.append((moment, lambda: act(at))))


def _person(made: Schedule) -> None:
    """A person who does not do what is asked, or late."""
    kind = made.rng.choice(("never confirms", "confirms late", "never jogs", "never restarts"))
    made.faults.append(f"person {kind}")

    def begin(at: World, _bad: Mischief, _task: asyncio.Task[Any]) -> None:
        person = at.person
        person.confirms = kind != "never confirms"
        person.confirm_after_s = 8.0 if kind == "confirms late" else 0.0
        person.jogs, person.restarts = kind != "never jogs", kind != "never restarts"

    made.late.append(begin)


def _disk(made: Schedule) -> None:
    """The journal's disk fails."""
    made.disk = Disk(made.rng.choice(FAULTS), made.rng.randrange(1, 12))
    made.faults.append(f"disk {made.disk.kind} at entry {made.disk.nth}")


def _calendar(made: Schedule) -> None:
    """The wall clock is set."""
    moment, seconds = made.moment(), made.rng.choice(JUMPS_S)
    made.faults.append(f"clock {seconds:+} s at {moment}")

    def begin(at: World, bad: Mischief, _task: asyncio.Task[Any]) -> None:
        def act() -> None:
            assert isinstance(at.clock, JumpingClock)
            at.clock.ahead_s += seconds

        bad.due.append((moment, act))

    made.late.append(begin)


def _stopped(made: Schedule) -> None:
    """The gateway is told to stop."""
    moment = made.moment()
    made.faults.append(f"stopped at {moment}")
    made.late.append(lambda _at, bad, task: bad.due.append((moment, lambda: stop(task))))


def stop(task: asyncio.Task[Any]) -> None:
    """Ctrl-C."""
    task.cancel()


KINDS: tuple[Callable[[Schedule], None], ...] = (
    _wire, _wire, _wire, _wire, _plc, _plc, _plc, _nck, _machine, _machine, _person, _disk, _calendar, _stopped,
    _whim, _whim,
)  # fmt: skip


# ---- one push --------------------------------------------------------------------------------------


def played(seed: int, folder: Path) -> Played:
    """The push of a seed, and the recovery of what it left, judged."""
    made = drawn(seed)
    found = Played(seed, made.faults)
    folder.mkdir(parents=True)

    async def main() -> None:
        clock = JumpingClock()
        bad = Mischief(clock, random.Random(seed + 1))
        async with world(made.scene, clock, bad.around) as at:
            await _play(made, at, bad, folder, found)

    run_virtual(main)
    return found


async def _play(made: Schedule, at: World, bad: Mischief, folder: Path, found: Played) -> None:
    device = watching(at.driver(), at.oracle)
    await device.open(5.0)
    base = await device.saved_tables("X1")
    machine = await device.identify()
    said: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        at.oracle.backed_up = at.oracle.backed_up or fields.get("step") == "BACKUP"
        at.person.hear(code, fields)

    more = {"say": say, "start_timeout_s": PATIENCE_S, "stop_timeout_s": PATIENCE_S}
    context = context_for(made.scene, device, at.clock, folder, machine, **more)
    bad.requests, bad.seen = 0, {}
    with failing(made.disk):
        task = asyncio.ensure_future(ended(push_table(change_of(made.scene, base), context)))
        for begin in made.late:
            begin(at, bad, task)
        found.outcome = await task
    await device.close()
    at.oracle.plc_lied = bool(at.station.plc.claimed_off)
    judge(at.oracle, found, said, context)
    found.whims = list(at.oracle.whims)
    await _mended(at, bad, off_and_on=made.rng.random() < 0.3)
    fresh = at.driver()
    await fresh.open(5.0)
    try:
        context = dataclasses.replace(context, controller=fresh, say=say, start_timeout_s=60.0)
        odd = set(made.scene.nck) - {"swaps_points_at_reset"}
        await settle(at.oracle, context, found, willing=not odd)
    finally:
        await fresh.close()


async def _mended(at: World, bad: Mischief, *, off_and_on: bool) -> None:
    """Everything is put right again: wire, PLC, key, alarms, person, disk."""
    bad.due.clear()
    bad.cut_after, bad.late_s, bad.repeats, bad.lie, bad.lost, bad.damage = 0, 0.0, 1, "", False, False
    at.person.confirms, at.person.jogs, at.person.restarts, at.person.confirm_after_s = True, True, True, 0.0
    at.person.wishes.clear()
    await at.clock.sleep(20.0)
    at.station.silent = False
    if not at.station.url:
        await at.station.plug(at.station.home)
    at.station.plc.change(**HONEST)
    at.station.plc.claimed_off.clear()
    at.nck.core.spec = dataclasses.replace(at.nck.core.spec, swaps_points_at_reset=None, enables_again_s=0.0)
    at.nck.set_access_level(2)
    await at.ready()
    at.nck.channel_reset()
    if off_and_on or at.nck.alarms:
        await at.station.power_cycle()
    await at.ready()


if __name__ == "__main__":
    for word in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as scratch:
            print(played(int(word), Path(scratch) / "push"))
