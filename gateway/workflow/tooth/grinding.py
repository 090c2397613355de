"""Grinds one test part through the control, with set-up values of its own, and stores what acted meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TrueflankError, words
from drivers.message import Message
from drivers.terms import spoken
from drivers.types.machine import ChannelStatus, MachineState
from drivers.workpiece import GrindAxis, GrindPlan
from gateway.config import SiteFile
from gateway.domain.equipment import Equipment
from gateway.errors import IllegalTransition, WriteRefused
from gateway.events import RunStarted
from gateway.moves import shown_by_control, tell_motion
from gateway.say import Say
from gateway.store import RunFolder, checked_name
from gateway.tooth import GroundPart, SetupValues
from gateway.workflow.axes.measure import store_equipment
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.tooth.part_plan import gear_of_site, grind_plan, work_section

TELL_EVERY = 5
LOOK_S = 0.5


def _dress(plan: GrindPlan, setup: SetupValues) -> Message | str:
    """What to do with the wheel before the program is started; "" where the program places it, or nothing does."""
    if plan.wheel_offset is None:
        return ""
    place = f"R{plan.wheel_offset}"
    return Message.of("W-GRIND-DRESS", dressing_um=setup.dressing_um, place=place, program=plan.name)


async def grind_site(
    site: SiteFile,
    site_path: Path,
    *,
    part: str,
    setup: SetupValues,
    machine_name: str,
    clock: Clock,
    say: Say,
    run: RunFolder | None = None,
) -> tuple[GroundPart, RunFolder]:
    """Grind one part at a site, in a run folder of its own or in ``run``, whose state stays what it was.

    Raises WriteRefused (E-GRIND-NAME), IllegalTransition (E-GRIND-AGAIN; E-SETUP-MACHINE: ``run`` is another
    machine's), and what `grind_part` raises; the folder keeps the error.
    """
    if machine_name != site.site.name:
        raise WriteRefused("E-GRIND-NAME", "--machine", typed=machine_name or "(nothing)", name=site.site.name)
    if run is not None and run.has(stages.ground(part)):
        raise IllegalTransition("E-GRIND-AGAIN", run.run_id, part=part)
    grind_plan(site, gear_of_site(site, site_path), setup, part)
    folder = run or new_run(site, site_path, utc=clock.utc)
    before = folder.state
    RunStarted(str(folder.path)).tell(say)
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            same_machine(at)
            made = await grind_part(at, part, setup)
    except TrueflankError as error:
        folder.set_state(before if run is not None else "failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state(before if run is not None else "stopped")
        raise
    folder.set_state(before if run is not None else "ground")
    return made, folder


def same_machine(at: RunContext) -> None:
    """Whose run this is: noted in a new one, compared in an older one.

    Raises IllegalTransition (E-SETUP-MACHINE) at another machine.
    """
    if not at.folder.has(stages.EQUIPMENT):
        store_equipment(at)
        return
    differ = at.folder.get(stages.EQUIPMENT, Equipment).machine.differences(at.machine)
    if differ:
        raise IllegalTransition("E-SETUP-MACHINE", at.folder.run_id, fields=", ".join(differ))


async def grind_part(at: RunContext, part: str, setup: SetupValues) -> GroundPart:
    """Grind the site's gear and store it as stage ``ground-<part>``; the operator starts, clamps and takes off.

    The program as sent and the live tables it saved stand in the run folder. Raises ConfigError (E-GRIND-...),
    UnsupportedDevice where the road runs no programs, DeviceRefused (E-GRIND-READY, alarm, reset), DeadlineExceeded;
    on any of these, and by the bench at a stop, the program is asked to end: between spaces with the wheel clear.
    """
    checked_name(f"grind-{part}{spoken().program_suffix}")
    plan = grind_plan(at.site, gear_of_site(at.site, at.site_path), setup, part)
    controller = at.supervisor.controller
    if controller.capabilities.grinding:
        await _check_ready(at, plan)
    at.standing.note(None)
    text = await controller.prepare_grinding(plan)
    at.folder.write_text(f"grind-{part}{spoken().program_suffix}", text)
    values = {"x_um": setup.x_um, "c_arcsec": setup.c_arcsec, "dressing_um": setup.dressing_um}
    at.say("P-GRIND-SETUP", part=part, **values)
    await tell_motion(controller, at.say)
    at.say("P-GRIND-PREPARED", part=part, program=plan.name, dress=_dress(plan, setup))
    try:
        started = await _follow(at, plan, part)
    except TrueflankError:
        await _ask_to_leave(at)
        raise
    live = {axis.name: await _save_live_tables(at, axis, part) for axis in plan.compensated}
    made = GroundPart(part=part, setup=setup, spaces=plan.spaces, started_utc=started, ended_utc=_utc(at), live=live)
    at.folder.put(stages.ground(part), made)
    return made


async def _ask_to_leave(at: RunContext) -> None:
    """The program leaves before its next space; waited for, so that nothing is given back under its feet."""
    with contextlib.suppress(TrueflankError):
        await at.supervisor.controller.abort_program()
        end = at.clock.now() + at.patience.stop_s
        while at.clock.now() < end:
            if (await at.supervisor.controller.state()).channel is not ChannelStatus.ACTIVE:
                return
            await at.clock.sleep(LOOK_S)


async def _follow(at: RunContext, plan: GrindPlan, part: str) -> str:
    """From the start until the part is taken off; when it began. A person acts before the first space and after all."""
    wait, patience = at.supervisor.controller.wait_ground, at.patience
    done = await wait(-1, patience.start_s)
    started = _utc(at)
    stock = work_section(at.site).stock_mm
    at.say("P-GRIND-BEGUN", part=part, stock=stock, shown=shown_by_control(at.supervisor.controller, "clamp"))
    while done is not None:
        person = done in (0, plan.spaces)
        reached = await wait(done, patience.start_s if person else patience.stop_s)
        if reached is not None:
            _tell(at, part, done, reached, plan.spaces)
        elif done < plan.spaces:
            raise DeviceRefused("E-GRIND-LEFT", plan.name, done=done, total=plan.spaces)
        done = reached
    return started


def _tell(at: RunContext, part: str, before: int, done: int, total: int) -> None:
    if done == total:
        shown = shown_by_control(at.supervisor.controller, "unclamp")
        at.say("P-GRIND-DONE", part=part, total=total, shown=shown)
    elif done // TELL_EVERY > before // TELL_EVERY:
        at.say("P-GRIND-SPACE", part=part, done=done, total=total)


async def _check_ready(at: RunContext, plan: GrindPlan) -> None:
    """Everything that stands against it at once. Raises DeviceRefused (E-GRIND-READY)."""
    controller = at.supervisor.controller
    found = await controller.identify()
    state = await controller.state()
    differ = at.machine.differences(found)
    reasons = [words("W-GRIND-MACHINE", fields=", ".join(differ))] if differ else []
    if found.unit_system != "metric":
        reasons.append(words("W-GRIND-UNITS", found=found.unit_system))
    reasons += _objections(state, plan)
    if reasons:
        raise DeviceRefused("E-GRIND-READY", at.site.site.name, why="; ".join(reasons))


def _objections(state: MachineState, plan: GrindPlan) -> list[str]:
    reasons = []
    if state.channel is not ChannelStatus.RESET:
        reasons.append(words("W-GRIND-CHANNEL", found=state.channel.name.lower()))
    if state.mode.upper() != "AUTO":
        reasons.append(words("W-GRIND-MODE", found=state.mode))
    if state.alarms:
        reasons.append(words("W-GRIND-ALARM", alarms=", ".join(map(str, state.alarms))))
    for name in (axis.name for axis in plan.named):
        axis = state.axes.get(name)
        if axis is None:
            reasons.append(words("W-GRIND-ABSENT", axis=name, known=", ".join(sorted(state.axes))))
        elif not axis.referenced:
            reasons.append(words("W-GRIND-REFERENCE", axis=name))
        elif not axis.in_position:
            reasons.append(words("W-GRIND-MOVING", axis=name))
    return reasons


async def _save_live_tables(at: RunContext, axis: GrindAxis, part: str) -> str:
    """The digest of what acted on an axis; its text goes into the run folder."""
    live = await at.supervisor.controller.saved_tables(axis.name)
    at.folder.write_text(f"tables-{axis.name}-{part}{spoken().tables_suffix}", live.native)
    at.say("P-GRIND-TABLES", part=part, axis=axis.name, digest=live.digest[:12])
    return live.digest


def _utc(at: RunContext) -> str:
    return at.clock.utc().isoformat(timespec="seconds")
