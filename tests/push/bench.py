"""One push through the mailbox with things done to it on the way, and what became of it: for tests of single faults."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from drivers.types.identity import MachineIdentity
from gateway.push import journal
from gateway.push.context import PushContext
from gateway.push.recovery import unfinished_tables
from gateway.push.transaction import push_table
from tests.push.judging import Played, ended, judge, settle
from tests.push.mischief import COMMANDS, Mischief, Moment
from tests.push.world import NEW, OLD, Scene, World, change_of, context_for, world

Deed = Callable[[World], None]
ALL_COMMANDS = tuple(COMMANDS.values())


@dataclass
class Story:
    """How it went. ``asked`` counts the PLC's commands by name; ``steps`` are the journal's kinds and reasons."""

    outcome: str = ""
    recovered: str = ""
    said: list[str] = field(default_factory=list)
    asked: dict[str, int] = field(default_factory=dict)
    steps: list[str] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    as_before: bool = False
    as_wanted: bool = False
    off: bool = False
    writes: int = 0
    marker: int = 0
    wrong: list[str] = field(default_factory=list)

    @property
    def restores(self) -> int:
        """How often it set out to put the old table back."""
        return sum(step == "ROLLING_BACK" for step in self.steps)


@dataclass
class Plan:
    """What is done to a push: ``at`` a moment on the wire, ``first`` before it, ``edit`` to its context."""

    scene: Scene = field(default_factory=Scene)
    at: tuple[tuple[Moment, Deed], ...] = ()
    first: Deed = lambda _at: None
    edit: Callable[[PushContext], PushContext] = lambda context: context
    recover: bool = True
    willing: bool = True
    mend: Deed = lambda _at: None


def told(plan: Plan, root: Path) -> Story:
    """Play it, judge it, and recover what it left."""
    story = Story()

    async def main() -> None:
        clock = LoopClock()
        wire = Mischief(clock, random.Random(1))
        async with world(plan.scene, clock, wire.around) as at:
            await _play(plan, at, wire, root, story)

    run_virtual(main)
    return story


async def _play(plan: Plan, at: World, wire: Mischief, root: Path, story: Story) -> None:
    device = at.driver()
    await device.open(5.0)
    base = await device.saved_tables("X1")
    _watch_jumps(at, story)

    def say(code: str, /, **fields: object) -> None:
        story.said.append(code)
        at.person.hear(code, fields)

    machine: MachineIdentity = await device.identify()
    context = plan.edit(context_for(plan.scene, device, at.clock, root, machine, say=say, start_timeout_s=15.0))
    at.oracle.writes, wire.seen = 0, {}
    plan.first(at)
    wire.due += [(moment, lambda deed=deed: deed(at)) for moment, deed in plan.at]  # type: ignore[misc]
    found = Played(0)
    found.outcome = story.outcome = await ended(push_table(change_of(plan.scene, base), context))
    wire.due.clear()
    await device.close()
    judge(at.oracle, found, story.said, context)
    _note(at, wire, context, story)
    if plan.recover:
        plan.mend(at)
        await at.clock.sleep(30.0)
        await at.ready()
        fresh = at.driver()
        await fresh.open(5.0)
        again = replace(context, controller=fresh, start_timeout_s=60.0, machine=await fresh.identify())
        await settle(at.oracle, again, found, willing=plan.willing)
        await fresh.close()
        story.recovered = found.recovered
    story.wrong = found.wrong


def _note(at: World, wire: Mischief, context: PushContext, story: Story) -> None:
    oracle = at.oracle
    story.asked = {name: count for name, count in wire.seen.items() if name}
    story.writes, story.marker = oracle.writes, at.station.plc.memory.marker_state
    story.as_before, story.as_wanted, story.off = oracle.as_before, oracle.as_wanted, oracle.off
    folder = journal.machine_folder(context.journals, context.machine.serial)
    for one in (*journal.read_journals(folder / "done"), *unfinished_tables(context.journals, context.machine.serial)):
        for entry in one.entries:
            story.steps += [entry.kind, str(entry.facts.get("why", ""))]


def _watch_jumps(at: World, story: Story) -> None:
    """How far each switching moves the axis where it stands, um."""
    axis = at.nck.core.axis("X1")
    real = axis.compensate

    def compensate(curve: Any, now_s: float) -> None:
        before = axis.table_value(now_s)
        real(curve, now_s)
        story.jumps.append(1000.0 * (axis.table_value(now_s) - before))

    axis.compensate = compensate  # type: ignore[method-assign]


__all__ = ["ALL_COMMANDS", "NEW", "OLD", "Moment", "Plan", "Scene", "Story", "told"]
