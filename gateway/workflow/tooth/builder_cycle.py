"""A part ground by the builder's own program: a person is asked for it, the control shows when it began and ended.

Nothing is sent to the control. Which program runs is compared with the one that was asked for, as far as the control
says it; the tables that act are read afterwards, so that the part is known with them.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.errors import DeadlineExceeded, DeviceRefused
from drivers.ports.controller import ReadsTogether
from drivers.types.machine import ChannelStatus, MachineState
from drivers.types.orders import TableQuestion
from drivers.types.tables import LiveSet
from gateway.errors import IllegalTransition
from gateway.store import checked_name
from gateway.study.inputs import gear_of
from gateway.tooth import BuilderCycle, GroundPart, SetupValues
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext
from gateway.workflow.tooth.part_plan import axes_of_work, gear_of_site

LOOK_S = 0.5
LONGEST_S = 8.0 * 3600.0  # of a cycle, with the people in it


def cycle_of_run(at: RunContext, asked: str, first: str) -> str:
    """The program that all parts of this run are ground by; "" for our own. Noted with the first part.

    Raises IllegalTransition (E-CYCLE-RESUME) where parts of the run were ground by another one.
    """
    folder = at.folder
    known = folder.get(stages.CYCLE, BuilderCycle).program if folder.has(stages.CYCLE) else ""
    begun = folder.has(stages.ground(first))
    if asked and asked != known and (known or begun):
        raise IllegalTransition("E-CYCLE-RESUME", folder.run_id, asked=asked, known=known or "-")
    if asked and not known:
        folder.put(stages.CYCLE, BuilderCycle(asked))
    return asked or known


async def grind_by_cycle(at: RunContext, part: str, setup: SetupValues, cycle: str) -> GroundPart:
    """Let a person grind a part by the builder's program, and store it as stage ``ground-<part>``.

    ``setup`` are the set-up values that were handed over in all. Raises DeadlineExceeded (E-CYCLE-NO-START,
    E-CYCLE-NO-END), DeviceRefused (E-CYCLE-OTHER, E-CYCLE-ALARM, E-CYCLE-BUSY), and what the control raises.
    """
    checked_name(f"ground-{part}")
    gear = gear_of(gear_of_site(at.site, at.site_path))
    state = await at.supervisor.controller.state()
    if state.channel is not ChannelStatus.RESET:
        raise DeviceRefused("E-CYCLE-BUSY", at.site.site.name, found=state.channel.name.lower())
    at.standing.note(None)
    at.say("P-CYCLE-RUN", part=part, program=cycle, minutes=round(at.patience.start_s / 60.0))
    await _wait_started(at, cycle)
    started = _utc(at)
    at.say("P-CYCLE-BEGUN", part=part, program=cycle)
    await _wait_ended(at, cycle)
    ended = _utc(at)
    at.say("P-CYCLE-ENDED", part=part, program=cycle)
    live = {name: found.digest for name, found in (await _live_tables(at)).items()}
    made = GroundPart(part=part, setup=setup, spaces=gear.zc, started_utc=started, ended_utc=ended, live=live)
    at.folder.put(stages.ground(part), made)
    return made


async def _wait_started(at: RunContext, cycle: str) -> None:
    end = at.clock.now() + at.patience.start_s
    while (state := await at.supervisor.controller.state()).channel is ChannelStatus.RESET:
        if at.clock.now() >= end:
            raise DeadlineExceeded("E-CYCLE-NO-START", at.site.site.name, program=cycle, timeout_s=at.patience.start_s)
        await at.clock.sleep(LOOK_S)
    if not runs_cycle(state, cycle):
        raise DeviceRefused("E-CYCLE-OTHER", at.site.site.name, program=cycle, found=state.program)


def runs_cycle(state: MachineState, cycle: str) -> bool:
    """Whether the control's program is the one named, whatever folder and ending it shows; it may not say any."""
    named = cycle.upper().rpartition("/")[2].partition(".")[0]
    return not state.program or named in state.program.upper()


async def _wait_ended(at: RunContext, cycle: str) -> None:
    end = at.clock.now() + LONGEST_S
    while (state := await at.supervisor.controller.state()).channel is not ChannelStatus.RESET:
        if at.clock.now() >= end:
            raise DeadlineExceeded("E-CYCLE-NO-END", at.site.site.name, program=cycle, hours=LONGEST_S / 3600.0)
        await at.clock.sleep(LOOK_S)
    if state.alarms:
        raise DeviceRefused("E-CYCLE-ALARM", at.site.site.name, program=cycle, alarms=", ".join(map(str, state.alarms)))


async def _live_tables(at: RunContext) -> Mapping[str, LiveSet]:
    """What compensates the axes that ground, read afresh; one program where the control can."""
    controller, start_s = at.supervisor.controller, at.patience.start_s
    axes = axes_of_work(at.site)
    asked = [
        TableQuestion(one.name, one.letter, unit, rotary=unit == "deg", encoder=one.encoder, start_s=start_s)
        for one, unit in ((axis, axis.facts.unit) for axis in axes)
    ]
    if isinstance(controller, ReadsTogether):
        found = await controller.live_tables_of(asked, at.say)
    else:
        found = tuple([await controller.live_tables(one, at.say) for one in asked])
    return {one.name: live for one, live in zip(axes, found, strict=True)}


def _utc(at: RunContext) -> str:
    return at.clock.utc().isoformat(timespec="seconds")
