"""What is accepted, in order: each check says what it saw, or raises what is wrong and what to do."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drivers import registry
from drivers.checks import Wanted
from drivers.errors import ConfigError, DeviceRefused
from drivers.probes import Allowance
from drivers.types.tables import LiveSet
from gateway.acceptance.working import NotHere, SiteDesk
from gateway.capture.sense import prove_sense
from gateway.config import AxisSection
from gateway.conform import prober_of
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.push.signproof import triangle_of
from gateway.say import silence
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.bench import Bench
from gateway.workflow.control.contexts import table_context
from gateway.workflow.control.proving import mount, provable, prove
from gateway.workflow.selftests import untested
from gateway.workflow.witness import Witness

START_S = 60.0
WRONG = "E-ACCEPT-WRONG"


@dataclass(frozen=True, slots=True)
class AcceptanceCheck:
    """One check: its least allowance, what it looks at, and the work, for each axis of the site where ``each``.

    The work gets the desk and the axis' name ("" without axes) and returns what it saw in one line.
    """

    name: str
    allow: Allowance
    what: str
    work: Callable[[SiteDesk, str], Coroutine[Any, Any, str]]
    each: bool = False


async def _road(desk: SiteDesk, _axis: str) -> str:
    """The doctor, from name and port to rights and machine data, without what it asks of the axes' tables."""
    control, name = desk.site.controller, desk.site.site.name
    if f"{control.driver}-doctor" not in registry.known("doctor"):
        raise NotHere(f"the driver {control.driver} has no doctor")
    doctor = registry.load(f"{control.driver}-doctor", "doctor")(name, control.url, control.settings, desk.clock)
    lines = await doctor.examine(Wanted(control.serial, access_level=control.access_level), control.timeout_s)
    bad = [f"{line.check}: {line.what}; {line.fix}" for line in lines if line.outcome == "wrong"]
    _demand(not bad, "connection", "; ".join(bad), "run `trueflank doctor` and follow its lines")
    clock = [line.what for line in lines if line.check == "clock"]
    open_ones = [line.check for line in lines if line.outcome == "unknown"]
    told = f", not told: {', '.join(open_ones)}" if open_ones else ""
    return f"{len(lines)} points of the connection are in order{told}; clock: {'; '.join(clock) or 'not told'}"


async def _identity(desk: SiteDesk, _axis: str) -> str:
    async with desk.bench() as at:
        first, second = at.machine, await at.supervisor.controller.identify()
    differs = first.differences(second)
    _demand(
        not differs, "identity", f"it changed between two readings: {differs}", "look for two controls at one address"
    )
    return f"serial {first.serial}, version {first.version}, axes {' '.join(first.axis_names)}, {first.unit_system}"


async def _axis_of(desk: SiteDesk, name: str) -> str:
    async with desk.bench() as at:
        axis, state = at.axis(name), await at.supervisor.controller.state()
    seen = state.axes.get(name)
    if seen is None:
        raise ConfigError(WRONG, name, what="axis", found="the control has no such axis", do="correct the site file")
    _demand(
        seen.unit == axis.unit, name, f"the control counts in {seen.unit}", "correct kind and unit in the site file"
    )
    _demand(seen.referenced, name, "the axis is not referenced", "reference it")
    return f"referenced, in {seen.unit}"


async def _limits(desk: SiteDesk, name: str) -> str:
    async with desk.bench() as at:
        axis = at.axis(name)
        limits = await at.supervisor.controller.table_limits(name, "axis", axis.encoder)
    grid = axis.table
    needed = round((grid.maximum - grid.minimum) / grid.step) + 1
    found = f"{limits.reserved_points} points reserved, {needed} needed, resolution {limits.resolution:g}"
    _demand(limits.reserved_points >= needed, name, found, "choose a larger step in the site file")
    _demand(limits.resolution > 0.0 and limits.max_value > 0.0, name, found, "tell us: the control gives no resolution")
    return found


async def _rights(desk: SiteDesk, _axis: str) -> str:
    """Nothing is written: the server is asked whether this user may."""
    try:
        prober = prober_of(desk.site, desk.clock)
    except ConfigError as error:
        raise NotHere("this connection has no user of its own whose rights could be asked") from error
    wanted = tuple(one for one in prober.probes("read") if one.name == "right-to-machine-datum")
    session = await prober.ask(wanted, silence, desk.site.controller.timeout_s, START_S)
    said = session.said("right-to-machine-datum")
    _demand(said != "yes", "rights", "this user may write machine data", "take SinuWriteAll and TeaWrite from the user")
    return f"may write machine data by variable: {said}"


async def _tested(desk: SiteDesk, name: str) -> str:
    async with desk.bench() as at:
        missing = untested(at, (name,))
        needed = at.supervisor.controller.capabilities.self_test
    _demand(not missing, name, "this version of the control has not passed the self-test", "run `trueflank self-test`")
    return "passed for this version" if needed else "not needed on this connection"


async def _tables(desk: SiteDesk, name: str) -> str:
    async with desk.bench() as at:
        return _told(await fetch_tables(at, at.axis(name)))


async def _sense(desk: SiteDesk, name: str) -> str:
    axis = _measured(desk, name)
    async with desk.bench((axis.measure.instrument,)) as at:
        proof = await prove_sense(at.rig(at.axis(name)))
    return f"the instrument follows the jog within 1 %, sense {proof.sense:+d}; every stop was answered"


async def _written(desk: SiteDesk, name: str) -> str:
    """A triangle of 3 um or 3 arcsec: written, read back, switched, seen, and the old table put back, proved equal."""
    axis = _measured(desk, name)
    async with desk.bench((axis.measure.instrument,)) as at:
        if not provable(at, at.axis(name)):
            raise NotHere("this connection cannot switch a table while a program waits")
        before = await fetch_tables(at, at.axis(name))
        proof = await _proof(at, at.axis(name), before)
        after = await fetch_tables(at, at.axis(name))
    if (before.own, before.cross) != (after.own, after.cross):
        raise VerifyError(WRONG, name, what="table", found="it is not as it was before", do="run `trueflank recover`")
    return f"slope {proof:+.3f} of one; {_told(after)}, as before"


async def _proof(at: Bench, axis: AxisSection, before: LiveSet) -> float:
    grid, facts = axis.table, at.facts(axis)
    table, _ = triangle_of(facts, facts, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)
    nothing = np.zeros(0)
    change = TableChange(
        axis=axis.name,
        old=before.own.table,
        new=table,
        old_enabled=before.own.enabled,
        base_digest=before.digest,
        targets=nothing,
        predicted=nothing,
        predicted_U=nothing,
    )
    context = replace(table_context(at, table, None), log=Witness(at))
    return (await prove(at, change, context, await mount(at, axis))).slope


def _measured(desk: SiteDesk, name: str) -> AxisSection:
    """An axis that a live instrument sees. Raises NotHere."""
    axis = next(one for one in desk.site.axes if one.name == name)
    if axis.measure.file is not None or not axis.measure.instrument:
        raise NotHere("the site file names no instrument for this axis")
    return axis


def _told(live: LiveSet) -> str:
    own = live.own
    state = "on" if own.enabled else "off"
    return f"axis table of {len(own.table.deviations)} points, {state}; {len(live.cross)} cross tables"


def _demand(held: bool, what: str, found: str, do: str) -> None:
    """Raises DeviceRefused (E-ACCEPT-WRONG)."""
    if not held:
        raise DeviceRefused(WRONG, what, what=what, found=found, do=do)


CHECKS: tuple[AcceptanceCheck, ...] = (
    AcceptanceCheck("connection", "read", "name, port, certificate, login, clock, machine data", _road),
    AcceptanceCheck("identity", "read", "serial number, version and axes, read twice", _identity),
    AcceptanceCheck("axis", "read", "known, in its unit, referenced", _axis_of, each=True),
    AcceptanceCheck("limits", "read", "room and resolution for the table of the site file", _limits, each=True),
    AcceptanceCheck("rights", "read", "the user may not write machine data by variable", _rights),
    AcceptanceCheck("self-test", "read", "a record for this version of the control", _tested, each=True),
    AcceptanceCheck("tables", "move", "the live tables, whole, by a program without motion", _tables, each=True),
    AcceptanceCheck("motion", "move", "a jog: hand-shake, unit and sense of the instrument", _sense, each=True),
    AcceptanceCheck("table", "write", "a table written, read back, switched and put back", _written, each=True),
)
