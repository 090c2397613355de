"""What is accepted, in order: each check says what it saw, or raises what is wrong and what to do."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drivers import registry
from drivers.checks import Wanted, WantedAxis
from drivers.errors import ConfigError, DeviceRefused
from drivers.probes import Allowance
from drivers.types.tables import LiveSet
from gateway.acceptance.results import ENGLISH, SeenLine, seen
from gateway.acceptance.working import NotHere, SiteDesk
from gateway.capture.rig import prove_sense
from gateway.config import AxisSection
from gateway.conform import prober_of
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.say import silence
from gateway.table.trial import triangle_for_axes
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.control.signs import MountedInstruments, can_prove_sign, prove_table_signs
from gateway.workflow.run.audit_trail import AuditAdapter
from gateway.workflow.run.context import RunContext
from gateway.workflow.run.folder import known_of, store_of
from gateway.workflow.run.push_context import table_context
from gateway.workflow.run.self_test import axes_without_self_test

START_S = 60.0
WRONG = "E-ACCEPT-WRONG"
TABLES = "table memory"
"""The doctor's lines that say for each axis what the check of its limits says."""


@dataclass(frozen=True, slots=True)
class AcceptanceCheck:
    """One check: its least allowance and the work, for each axis of the site where ``each``.

    The work gets the desk and the axis' name ("" without axes) and returns what it saw in one line. What it looks at
    stands in the document's catalogue, "accept_what_" and its name.
    """

    name: str
    allow: Allowance
    work: Callable[[SiteDesk, str], Coroutine[Any, Any, SeenLine]]
    each: bool = False


async def _road(desk: SiteDesk, _axis: str) -> SeenLine:
    """The doctor, from name and port to rights and machine data; the axes' tables are judged one by one elsewhere."""
    control, name = desk.site.controller, desk.site.site.name
    if f"{control.driver}-doctor" not in registry.known("doctor"):
        raise NotHere("no-doctor", driver=control.driver)
    doctor = registry.load(f"{control.driver}-doctor", "doctor")(name, control.url, control.settings, desk.clock)
    facts = known_of(desk.site, store_of(desk.site, desk.site_path).root).facts
    axes = tuple(
        WantedAxis(one.name, one.unit, one.encoder, points=_points(one), encoder_said=one.encoder_said)
        for one in desk.site.axes
    )
    serial = facts.get("serial", control.serial)
    wanted = Wanted(serial, axes, access_level=control.access_level, facts=facts)
    lines = [one for one in await doctor.examine(wanted, control.timeout_s) if one.check != TABLES]
    bad = [f"{line.check}: {line.what}; {line.fix}" for line in lines if line.outcome == "wrong"]
    _demand(not bad, "connection", "; ".join(bad), "run `trueflank doctor` and follow its lines")
    clock = [line.what for line in lines if line.check == "clock"]
    open_ones = [line.check for line in lines if line.outcome == "unknown"]
    # "-" where there is nothing to name: the sheet's words are for every language.
    return seen("connection", count=len(lines), clock="; ".join(clock) or "-", open=", ".join(open_ones) or "-")


async def _identity(desk: SiteDesk, _axis: str) -> SeenLine:
    async with desk.bench() as at:
        first, second = at.machine, await at.supervisor.controller.identify()
    differs = first.differences(second)
    _demand(
        not differs, "identity", f"it changed between two readings: {differs}", "look for two controls at one address"
    )
    axes = " ".join(first.axis_names)
    return seen("identity", serial=first.serial, version=first.version, axes=axes, unit=first.unit_system)


async def _axis_of(desk: SiteDesk, name: str) -> SeenLine:
    async with desk.bench() as at:
        axis, state = at.axis(name), await at.supervisor.controller.state()
    found = state.axes.get(name)
    if found is None:
        raise ConfigError(WRONG, name, what="axis", found="the control has no such axis", do="correct the site file")
    _demand(
        found.unit == axis.unit, name, f"the control counts in {found.unit}", "correct kind and unit in the site file"
    )
    _demand(found.referenced, name, "the axis is not referenced", "reference it")
    return seen("axis", unit=found.unit)


async def _limits(desk: SiteDesk, name: str) -> SeenLine:
    async with desk.bench() as at:
        axis = at.axis(name)
        limits = await at.supervisor.controller.table_limits(name, "axis", axis.encoder)
    needed = _points(axis)
    line = seen("limits", reserved=limits.reserved_points, needed=needed, resolution=f"{limits.resolution:g}")
    found = line.told(ENGLISH)
    _demand(limits.reserved_points >= needed, name, found, "choose a larger step in the site file")
    _demand(limits.resolution > 0.0 and limits.max_value > 0.0, name, found, "tell us: the control gives no resolution")
    return line


def _points(axis: AxisSection) -> int:
    grid = axis.table
    return round((grid.maximum - grid.minimum) / grid.step) + 1


async def _rights(desk: SiteDesk, _axis: str) -> SeenLine:
    """Nothing is written: the server is asked whether this user may."""
    try:
        prober = prober_of(desk.site, desk.clock)
    except ConfigError as error:
        raise NotHere("no-user") from error
    wanted = tuple(one for one in prober.probes("read") if one.name == "right-to-machine-datum")
    session = await prober.ask(wanted, silence, desk.site.controller.timeout_s, START_S)
    said = session.said("right-to-machine-datum")
    _demand(said != "yes", "rights", "this user may write machine data", "take SinuWriteAll and TeaWrite from the user")
    return seen("rights-no" if said == "no" else "rights-unknown")


async def _tested(desk: SiteDesk, name: str) -> SeenLine:
    async with desk.bench() as at:
        missing = axes_without_self_test(at, (name,))
        needed = at.supervisor.controller.capabilities.self_test
    _demand(
        not missing,
        name,
        "this version of the control has not passed the self-test",
        f"run `trueflank doctor self-test {desk.site_path}`",
    )
    return seen("tested" if needed else "test-not-needed")


async def _tables(desk: SiteDesk, name: str) -> SeenLine:
    async with desk.bench() as at:
        return _told(await fetch_tables(at, at.axis(name)))


async def _sense(desk: SiteDesk, name: str) -> SeenLine:
    axis = _measured(desk, name)
    async with desk.bench((axis.measure.instrument,)) as at:
        proof = await prove_sense(at.rig(at.axis(name)))
    return seen("sense", sense=f"{proof.sense:+d}")


async def _written(desk: SiteDesk, name: str) -> SeenLine:
    """A triangle of 3 um or 3 arcsec: written, read back, switched, seen, and the old table put back, proved equal."""
    axis = _measured(desk, name)
    async with desk.bench((axis.measure.instrument,)) as at:
        if not can_prove_sign(at, at.axis(name)):
            raise NotHere("no-switch")
        before = await fetch_tables(at, at.axis(name))
        slope = await _proof(at, at.axis(name), before)
        after = await fetch_tables(at, at.axis(name))
    if (before.own, before.cross) != (after.own, after.cross):
        raise VerifyError(WRONG, name, what="table", found="it is not as it was before", do="run `trueflank recover`")
    return seen(f"written-{_state(after)}", slope=f"{slope:+.3f}", **_told(after).fields)


async def _proof(at: RunContext, axis: AxisSection, before: LiveSet) -> float:
    grid, facts = axis.table, at.facts(axis)
    table, _ = triangle_for_axes(facts, facts, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)
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
    context = replace(table_context(at, table, None), log=AuditAdapter(at))
    (found,) = await prove_table_signs(at, ((change, context),), MountedInstruments(at))
    if isinstance(found, VerifyError):
        raise found
    return found.slope


def _measured(desk: SiteDesk, name: str) -> AxisSection:
    """An axis that a live instrument sees. Raises NotHere."""
    axis = next(one for one in desk.site.axes if one.name == name)
    if axis.measure.file is not None or not axis.measure.instrument:
        raise NotHere("no-instrument")
    return axis


def _told(live: LiveSet) -> SeenLine:
    own = live.own
    return seen(f"tables-{_state(live)}", points=len(own.table.deviations), cross=len(live.cross))


def _state(live: LiveSet) -> str:
    return "on" if live.own.enabled else "off"


def _demand(held: bool, what: str, found: str, do: str) -> None:
    """Raises DeviceRefused (E-ACCEPT-WRONG)."""
    if not held:
        raise DeviceRefused(WRONG, what, what=what, found=found, do=do)


CHECKS: tuple[AcceptanceCheck, ...] = (
    AcceptanceCheck("connection", "read", _road),
    AcceptanceCheck("identity", "read", _identity),
    AcceptanceCheck("axis", "read", _axis_of, each=True),
    AcceptanceCheck("limits", "read", _limits, each=True),
    AcceptanceCheck("rights", "read", _rights),
    AcceptanceCheck("self-test", "read", _tested, each=True),
    AcceptanceCheck("tables", "move", _tables, each=True),
    AcceptanceCheck("motion", "move", _sense, each=True),
    AcceptanceCheck("table", "write", _written, each=True),
)
