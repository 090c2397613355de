"""The doctor: everything that is asked of a site's control, in order and by level, and how each question ended.

The levels hold each other. `read` looks, and nobody acts. `program` has a person start programs that move nothing: the
self-test where this version has none, and all live tables. `motion` jogs each axis under its instrument. `write` tries
a table of 3 um or 3 arcsec by the push's own transaction, and puts the old one back; a machine is asked for its name
before. One record, `CheckResult`, is what `doctor` prints, what `doctor accept` puts on the sheet to sign, and what a
case of the pytest suite ends with. Each check opens the control anew: one that fails leaves nothing to the next.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Collection, Coroutine, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.checks import CheckLine, Outcome, failed, fine, skipped, wrong
from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.probes import Level, allows
from drivers.types.tables import LiveSet
from gateway.acceptance.comparison import prober_of
from gateway.acceptance.control import examine_control, self_test_line
from gateway.broker import borrow_devices
from gateway.capture.rig import prove_sense
from gateway.config import AxisSection, SiteFile
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.say import Say, silence
from gateway.table.trial import triangle_for_axes
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.control.signs import MountedInstruments, can_prove_sign, prove_table_signs
from gateway.workflow.run.audit_trail import AuditAdapter
from gateway.workflow.run.context import RunContext, open_context, run_or_look
from gateway.workflow.run.folder import store_of
from gateway.workflow.run.push_context import table_context
from gateway.workflow.run.self_test import axes_without_self_test, last_self_test, self_test_site

START_S = 60.0
WORST_FIRST: tuple[Outcome, ...] = ("wrong", "unknown", "ok", "skipped")
SELF_TEST_LINES = ("self-test", "self-test kept")
Lines = tuple[CheckLine, ...]


@dataclass(frozen=True, slots=True)
class SiteDesk:
    """A site that is examined. Whoever makes one has the consent that its checks need."""

    site: SiteFile
    site_path: Path
    clock: Clock
    say: Say

    @asynccontextmanager
    async def bench(self, instruments: Collection[str] = ()) -> AsyncIterator[RunContext]:
        """The control and these instruments, open; a run folder is left only where an instrument was at work."""
        with run_or_look(self.site, self.site_path, "accepting", look=not instruments) as folder:
            at = open_context(
                self.site,
                self.site_path,
                folder=folder,
                clock=self.clock,
                say=self.say,
                instruments=tuple(instruments),
            )
            async with at as opened:
                yield opened
            folder.set_state("accepted")


@dataclass(frozen=True, slots=True)
class DoctorCheck:
    """One check: its least level and the work, for each axis of the site where ``each``.

    The work gets the desk and the axis' name ("" without axes) and returns what it saw; what it looks at stands in the
    document's catalogue, "accept_what_" and its name. A ``road`` that cannot be gone ends the examination by its error;
    of the others our own errors are results.
    """

    name: str
    level: Level
    work: Callable[[SiteDesk, str], Coroutine[Any, Any, Lines]]
    each: bool = False
    road: bool = False


@dataclass(frozen=True, slots=True)
class CheckResult:
    """How one check ended for an axis ("" for the site as a whole), as the lines that it saw."""

    check: str
    axis: str
    level: Level
    lines: Lines

    @property
    def name(self) -> str:
        """As people read it: "motion X1"."""
        return f"{self.check} {self.axis}".strip()

    @property
    def outcome(self) -> Outcome:
        """The worst of its lines."""
        found = {line.outcome for line in self.lines}
        return next(one for one in WORST_FIRST if one in found)

    @property
    def said(self) -> str:
        """What is not in order with what to do, else all that was seen; in English, for JUnit."""
        bad = [f"{line.what} -> {line.fix}" for line in self.lines if line.outcome == "wrong"]
        return "; ".join(bad or [line.what for line in self.lines])

    def as_records(self) -> list[dict[str, object]]:
        """Its lines as data, each with the level that it needs."""
        return [{**line.as_record(), "level": self.level} for line in self.lines]


async def examine_site(
    desk: SiteDesk, level: Level, tell: Callable[[CheckResult], None], *, above: bool = False
) -> tuple[CheckResult, ...]:
    """Every check up to a level, in order; ``above``: what lies higher is in the result, too, as skipped.

    Raises what the road to the control raises: the doctor's driver, and devices that somebody else has.
    """
    results = []
    for check, axis in cases(desk.site):
        if above or allows(level, check.level):
            results.append(await run_check(check, axis, desk, level))
            tell(results[-1])
    return tuple(results)


def cases(site: SiteFile) -> Iterator[tuple[DoctorCheck, str]]:
    """Every check with the axis it is made for ("" for the site as a whole), in order."""
    for check in CHECKS:
        for axis in (axis.name for axis in site.axes) if check.each else ("",):
            yield check, axis


async def run_check(check: DoctorCheck, axis: str, desk: SiteDesk, level: Level) -> CheckResult:
    """One check; what lies above the level is skipped and said. Raises what the work of a ``road`` raises."""
    if not allows(level, check.level):
        lines: Lines = (skipped("W-DOC-ABOVE", check.name, needed=check.level, given=level),)
    else:
        try:
            lines = await check.work(desk, axis)
        except TrueflankError as error:
            if check.road:
                raise
            lines = (failed(error, check.name),)
    if check.road and allows(level, "program"):
        # The self-test is a check of that level: what reading could not tell of it is found out there.
        lines = tuple(one for one in lines if one.outcome != "unknown" or one.check not in SELF_TEST_LINES)
    return CheckResult(check.name, axis, check.level, lines)


# ---- the checks


async def _road(desk: SiteDesk, _axis: str) -> Lines:
    """From name and port to rights and machine data, and what this PC knows of the control."""
    async with borrow_devices(store_of(desk.site, desk.site_path).root, "doctor", desk.clock):
        return await examine_control(desk.site, desk.site_path, desk.clock)


async def _rights(desk: SiteDesk, _axis: str) -> Lines:
    """Nothing is written: the server is asked, in a session of its own, whether this user may."""
    try:
        prober = prober_of(desk.site, desk.clock)
    except ConfigError:
        return (skipped("W-DOC-NO-USER", "rights"),)
    wanted = tuple(one for one in prober.probes("read") if one.name == "right-to-machine-datum")
    session = await prober.ask(wanted, silence, desk.site.controller.timeout_s, START_S)
    said = session.said("right-to-machine-datum")
    if said == "yes":
        return (wrong("E-DOC-DATA-RIGHT", "rights"),)
    return (fine("W-DOC-DATA-REFUSED" if said == "no" else "W-DOC-DATA-UNKNOWN", "rights"),)


async def _axis_of(desk: SiteDesk, name: str) -> Lines:
    async with desk.bench() as at:
        axis, state = at.axis(name), await at.supervisor.controller.state()
    found = state.axes.get(name)
    if found is None:
        return (wrong("E-DOC-NO-AXIS", "axis", axis=name, known=", ".join(state.axes)),)
    if found.unit != axis.unit:
        return (wrong("E-DOC-AXIS-UNIT", "axis", axis=name, unit=found.unit, wanted=axis.unit),)
    if not found.referenced:
        return (wrong("E-DOC-UNREFERENCED", "axis", axis=name),)
    return (fine("W-DOC-REFERENCED", "axis", axis=name, unit=found.unit),)


async def _tested(desk: SiteDesk, name: str) -> Lines:
    """The self-test of this version: that which is kept, else it is made now."""
    async with desk.bench() as at:
        if not at.supervisor.controller.capabilities.self_test:
            return (fine("W-DOC-TEST-NOT-NEEDED", "self-test"),)
        missing = axes_without_self_test(at, (name,))
    if missing:
        await self_test_site(desk.site, desk.site_path, axis=name, clock=desk.clock, say=desk.say)
    return (self_test_line(name, last_self_test(at, at.axis(name)), at.machine.version),)


async def _tables(desk: SiteDesk, name: str) -> Lines:
    async with desk.bench() as at:
        live = await fetch_tables(at, at.axis(name))
    return (fine("W-DOC-TABLES-ON" if live.own.enabled else "W-DOC-TABLES-OFF", "tables", axis=name, **_counts(live)),)


async def _sense(desk: SiteDesk, name: str) -> Lines:
    instrument = _instrument_of(desk, name)
    if not instrument:
        return (skipped("W-DOC-NO-INSTRUMENT", "motion", axis=name),)
    async with desk.bench((instrument,)) as at:
        proof = await prove_sense(at.rig(at.axis(name)))
    return (fine("W-DOC-SENSE", "motion", axis=name, sense=f"{proof.sense:+d}"),)


async def _written(desk: SiteDesk, name: str) -> Lines:
    """A triangle of 3 um or 3 arcsec: written, read back, switched, seen, and the old table put back, proved equal."""
    instrument = _instrument_of(desk, name)
    if not instrument:
        return (skipped("W-DOC-NO-INSTRUMENT", "table", axis=name),)
    async with desk.bench((instrument,)) as at:
        if not can_prove_sign(at, at.axis(name)):
            return (skipped("W-DOC-NO-SWITCH", "table", axis=name),)
        before = await fetch_tables(at, at.axis(name))
        slope = await _proof(at, at.axis(name), before)
        after = await fetch_tables(at, at.axis(name))
    if (before.own, before.cross) != (after.own, after.cross):
        return (wrong("E-DOC-TABLE-OTHER", "table", axis=name),)
    code = "W-DOC-WRITTEN-ON" if after.own.enabled else "W-DOC-WRITTEN-OFF"
    return (fine(code, "table", axis=name, slope=f"{slope:+.3f}", **_counts(after)),)


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


def _instrument_of(desk: SiteDesk, name: str) -> str:
    """The live instrument that sees an axis; "" where there is none."""
    measure = next(one for one in desk.site.axes if one.name == name).measure
    return "" if measure.file is not None else measure.instrument


def _counts(live: LiveSet) -> dict[str, int]:
    return {"points": len(live.own.table.deviations), "cross": len(live.cross)}


CHECKS: tuple[DoctorCheck, ...] = (
    DoctorCheck("connection", "read", _road, road=True),
    DoctorCheck("rights", "program", _rights),
    DoctorCheck("axis", "program", _axis_of, each=True),
    DoctorCheck("self-test", "program", _tested, each=True),
    DoctorCheck("tables", "program", _tables, each=True),
    DoctorCheck("motion", "motion", _sense, each=True),
    DoctorCheck("table", "write", _written, each=True),
)
