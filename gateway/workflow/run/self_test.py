"""Self-tests of the control: run by the command, and demanded before hours of measuring are spent on a push."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded, DeviceRefused, TrueflankError
from drivers.message import Message
from drivers.programs import SelfTest, SelfTested, SelfTests, WritesWithout
from drivers.types.machine import ChannelStatus
from gateway import audit
from gateway.config import AxisSection, SiteFile, files_only
from gateway.errors import WriteRefused
from gateway.moves import shown_by_control
from gateway.say import Say
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.run.audit_trail import report_log_problem
from gateway.workflow.run.context import RunContext, axis_named, open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.outcome import Outcome


def last_self_test(at: RunContext, axis: AxisSection) -> SelfTested | None:
    """The last self-test of an axis, of this very machine or else of what it was before. Raises StoreError."""
    return SelfTestBook(at.store.root).last(at.machine, axis.name, axis.encoder)


def axes_without_self_test(at: RunContext, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the axes by name that this very control has not passed a self-test for; none where it needs none."""
    if not at.supervisor.controller.capabilities.self_test:
        return ()
    found = {name: last_self_test(at, at.axis(name)) for name in dict.fromkeys(names)}
    return tuple(name for name, test in found.items() if test is None or not _is_valid(at, test))


def _is_valid(at: RunContext, test: SelfTested) -> bool:
    return test.ok and not test.machine.differences(at.machine)


def self_test_warnings(at: RunContext, names: Iterable[str]) -> tuple[Message, ...]:
    """What a proposal for these axes must say, in words; nothing where every one is tested."""
    missing = axes_without_self_test(at, names)
    return (Message.of("W-RUN-SELF-TEST", axes=", ".join(missing)),) if missing else ()


def require_self_tests(at: RunContext) -> None:
    """Before hours of measuring: what a push would be refused for.

    Raises WriteRefused (E-RUN-PLACES: axes of the control without a safe place; E-RUN-SELF-TEST).
    """
    unplaced = [name for name in at.machine.axis_names if name not in at.site.moves.places.ranges]
    if unplaced:
        raise WriteRefused("E-RUN-PLACES", at.site.site.name, axes=", ".join(unplaced), first=unplaced[0])
    missing = axes_without_self_test(at, (axis.name for axis in at.site.axes))
    if missing:
        raise WriteRefused("E-RUN-SELF-TEST", at.site.site.name, axes=", ".join(missing))


# The self-test of a site's control: one program for each axis, started by a person, its outcome kept for good.

RESET_LOOK_S = 0.5


async def self_test_site(site: SiteFile, site_path: Path, *, axis: str, clock: Clock, say: Say) -> Outcome:
    """Test every axis of a site, or the one that is named; no instrument is opened and nothing moves.

    Each outcome is kept before the next begins. Raises ConfigError (E-RUN-AXIS; E-FILES-ONLY, with no run folder left),
    DeviceRefused (E-SELF-TEST) when words were not passed, DeadlineExceeded (E-NC-NO-START) when nobody started it,
    StoreError.
    """
    if files_only(site):
        raise ConfigError("E-FILES-ONLY", site.site.name)
    axes = (axis_named(site, site_path, axis),) if axis else tuple(site.axes)
    folder = new_run(site, site_path, measures=False, utc=clock.utc)
    folder.set_state("self-testing")
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            controller = at.supervisor.controller
            if not controller.capabilities.self_test or not isinstance(controller, SelfTests):
                return _no_programs_outcome(at)
            if isinstance(controller, WritesWithout):
                controller.do_without(())  # what it did not take before is tried again
            return _outcome(at, tuple([await _test_axis(at, controller, one) for one in axes]))
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


async def _test_axis(at: RunContext, controller: SelfTests, axis: AxisSection) -> SelfTested:
    """One axis: sent, started by a person, read and kept, in the audit log too."""
    order = SelfTest(axis.name, axis.encoder, axis.encoder_said)
    await controller.prepare_self_test(order)
    at.say("P-SELF-TEST", axis=axis.name, shown=shown_by_control(at.supervisor.controller, "self-test"))
    found = await controller.wait_self_test(order, at.patience.start_s)
    SelfTestBook(at.store.root).save(found)
    told = {"axis": axis.name, "run": at.folder.run_id, "version": found.machine.version, "missed": found.missed}
    action = "self-test-passed" if found.ok else "self-test-failed"
    root, serial = at.store.root, at.machine.serial
    report_log_problem(at, audit.note(root, action, clock=at.clock, serial=serial, details=told))
    at.say("P-SELF-TEST-PASSED" if found.ok else "P-SELF-TEST-FAILED", **_fields(found))
    if found.without and isinstance(controller, WritesWithout):
        controller.do_without(found.without)
        await _wait_for_reset(at, found)
    return found


async def _wait_for_reset(at: RunContext, found: SelfTested) -> None:
    """A word that the control does not take stopped the program: the person resets it. Raises DeadlineExceeded."""
    controller, end = at.supervisor.controller, at.clock.now() + at.patience.start_s
    if (await controller.state()).channel is ChannelStatus.RESET:
        return
    at.say("P-SELF-TEST-WITHOUT", axis=found.axis, words=", ".join(found.without))
    while (await controller.state()).channel is not ChannelStatus.RESET:
        if at.clock.now() >= end:
            raise DeadlineExceeded("E-SELF-TEST-RESET", at.site.site.name, axis=found.axis)
        await at.clock.sleep(RESET_LOOK_S)


def _fields(test: SelfTested) -> dict[str, object]:
    date = test.control_date or "no date"
    return {"axis": test.axis, "passed": len(test.passed), "missed": test.missed, "control_date": date}


def _outcome(at: RunContext, found: tuple[SelfTested, ...]) -> Outcome:
    """Raises DeviceRefused (E-SELF-TEST)."""
    failed = [test for test in found if not test.ok]
    if failed:
        missed = "; ".join(f"{test.axis}: {test.missed}" for test in failed)
        raise DeviceRefused("E-SELF-TEST", at.site.site.name, missed=missed)
    at.folder.set_state("self-tested")
    lines = tuple(Message.of("W-SELF-TEST-PASSED", version=test.machine.version, **_fields(test)) for test in found)
    missing = ", ".join(dict.fromkeys(word for test in found for word in test.without))
    lines += (Message.of("W-SELF-TEST-WITHOUT", words=missing),) if missing else ()
    data = {"axes": {test.axis: {"passed": list(test.passed), "control_date": test.control_date} for test in found}}
    data |= {"version": at.machine.version}  # type: ignore[dict-item]
    return Outcome(state=at.folder.state, run_folder=str(at.folder.path), rows=(), lines=lines, data=data)


def _no_programs_outcome(at: RunContext) -> Outcome:
    at.folder.set_state("not-needed")
    lines = (Message.of("W-SELF-TEST-NONE", site=at.site.site.name),)
    return Outcome(state=at.folder.state, run_folder=str(at.folder.path), rows=(), lines=lines, data={"axes": {}})
