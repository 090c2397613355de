"""The context of a run: site, devices, store, clock and people's patience, opened together and left in order.

The devices are borrowed from a gateway that serves the site, else opened here. Whatever ends a run, what it sent to the
control is asked to end first, its R parameters are given back, and only then the connections are closed.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Collection, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.local.names import shown
from drivers.message import Message
from drivers.offline_exchange import OfflineExchange
from drivers.ports.controller import Controller
from drivers.programs import ForeseesPlans, ProgramText, SaysMotion, SendsPrograms, WritesWithout
from drivers.stale_programs import NOTHING, LeavesPrograms, StaleProgram
from drivers.types.identity import MachineIdentity
from drivers.types.stops import StopPlan
from gateway import audit, stopping
from gateway.axes import AxisRecord
from gateway.broker import borrow_devices
from gateway.capture.rig import Rig, StandingOptics
from gateway.config import AxisSection, SiteFile, files_only
from gateway.domain.identity import KnownFact
from gateway.errors import StoreError, WriteRefused
from gateway.events import ConnectionUnprotected, DevicesOpened
from gateway.moves import Patience
from gateway.push import JOURNALS, SentProgramBook
from gateway.say import Say
from gateway.store import RunFolder, Store
from gateway.store.machine_books import ProofBook, SelfTestBook
from gateway.supervisor import Supervisor
from gateway.workflow.run.folder import new_run, origin_of, store_of
from gateway.workflow.run.identity import IdentityCheck


@dataclass(frozen=True, slots=True)
class RunContext:
    """Everything a stage may use. ``machine`` is the fingerprint met when the devices were opened.

    ``accepted`` are changes of the machine's identity that a person answers for.
    """

    site: SiteFile
    site_path: Path
    supervisor: Supervisor
    machine: MachineIdentity
    folder: RunFolder
    store: Store
    proofs: ProofBook
    clock: Clock
    say: Say
    standing: StandingOptics = field(default_factory=StandingOptics)
    accepted: tuple[KnownFact, ...] = ()

    @property
    def patience(self) -> Patience:
        """How long to wait for people and moves."""
        operator = self.site.operator
        return Patience(operator.start_timeout_s, operator.stop_timeout_s)

    def rig(self, axis: AxisSection) -> Rig:
        """An axis of the site set up with the instrument it names."""
        instrument = self.supervisor.instrument(axis.measure.instrument)
        return Rig(
            axis=axis,
            controller=self.supervisor.controller,
            instrument=instrument,
            clock=self.clock,
            patience=self.patience,
            say=self.say,
        )

    async def foresee(self, plans: Sequence[StopPlan]) -> None:
        """What will be visited next, in order, for a control that makes one program of it; none: nothing follows."""
        if isinstance(self.supervisor.controller, ForeseesPlans):
            await self.supervisor.controller.foresee(plans)

    def axis(self, name: str) -> AxisSection:
        """An axis of the site by its machine name."""
        return axis_named(self.site, self.site_path, name)

    def facts(self, axis: AxisSection) -> AxisRecord:
        """What a push must know of an axis, with its safe place where the site file names one."""
        return replace(axis.facts, safe=self.site.moves.places.ranges.get(axis.name))

    @property
    def open_road(self) -> Message | None:
        """Why others on the network could read or change what passes to the control; None where they cannot."""
        return self.supervisor.controller.capabilities.unprotected

    @property
    def moved(self) -> frozenset[str]:
        """Machine names of the axes that are moved and measured; every other stands still."""
        return frozenset(axis.name for axis in self.site.axes)


@contextmanager
def run_or_look(site: SiteFile, site_path: Path, state: str, *, look: bool) -> Iterator[RunFolder]:
    """The folder of a run that measures nothing and begins with ``state``; of a ``look`` one that goes with it.

    What stays of a look is its line in the audit log (`audit_trail.record_look`). Raises ConfigError (E-FILES-ONLY)
    before there is a folder.
    """
    if files_only(site):
        raise ConfigError("E-FILES-ONLY", site.site.name)
    with TemporaryDirectory(prefix="trueflank-look-") as short_lived:
        folder = new_run(site, site_path, Store(Path(short_lived)) if look else None, measures=False)
        folder.set_state(state)
        try:
            yield folder
        except TrueflankError as error:
            folder.set_state("failed", error=error.as_record())
            raise


def keep_look(at: RunContext) -> str:
    """The folder of a look that found something worth keeping, copied into the site's store. Raises StoreError."""
    try:
        return str(copytree(at.folder.path, at.store.root / at.folder.run_id))
    except OSError as error:
        raise StoreError("E-STORE-DISK", str(at.store.root), why=error.strerror or str(error)) from error


def with_axes(site: SiteFile, names: Collection[str]) -> SiteFile:
    """The site with these axes alone, in its own order; all where none is named. Raises ConfigError (E-RUN-AXIS)."""
    known = [axis.name for axis in site.axes]
    for name in names:
        if name not in known:
            raise ConfigError("E-RUN-AXIS", site.site.name, axis=shown(name), known=", ".join(known))
    chosen = tuple(axis for axis in site.axes if axis.name in names)
    return site.model_copy(update={"axes": chosen}) if chosen else site


def axis_named(site: SiteFile, site_path: Path, name: str) -> AxisSection:
    """An axis by its machine name; asked before a device is opened where a person typed it.

    Raises ConfigError (E-RUN-AXIS).
    """
    for axis in site.axes:
        if axis.name == name:
            return axis
    known = ", ".join(axis.name for axis in site.axes)
    raise ConfigError("E-RUN-AXIS", str(site_path), axis=shown(name), known=known)


def check_name(
    site: SiteFile, apply: bool, machine_name: str, code: str = "E-RUN-NAME", option: str = "--machine"
) -> None:
    """Consent names the machine. Raises WriteRefused (E-RUN-NAME, or the ``code`` that names other options)."""
    if apply and machine_name != site.site.name:
        raise WriteRefused(code, option, typed=machine_name or "(nothing)", name=site.site.name)


@asynccontextmanager
async def open_context(
    site: SiteFile,
    site_path: Path,
    folder: RunFolder,
    clock: Clock,
    say: Say,
    instruments: Collection[str] | None = None,
) -> AsyncIterator[RunContext]:
    """Open the controller and the instruments (all failures at once), hand out the context, close everything.

    While a gateway serves this site its devices are asked for first: raises what `gateway.broker.borrow_devices` does.
    A failure or a stop leaves the machine in order first: what was sent is asked to end, and what is left is told.

    Without ``instruments`` those that measure the site's axes; others may stand in the site file unplugged.
    """
    root = store_of(site, site_path).root
    async with (
        borrow_devices(root, folder.run_id, clock, say) as told,
        _open_devices(site, site_path, folder=folder, clock=clock, say=told, instruments=instruments) as at,
    ):
        yield at


@asynccontextmanager
async def _open_devices(
    site: SiteFile,
    site_path: Path,
    folder: RunFolder,
    clock: Clock,
    say: Say,
    instruments: Collection[str] | None,
) -> AsyncIterator[RunContext]:
    used = {axis.measure.instrument for axis in site.axes} if instruments is None else set(instruments)
    store = store_of(site, site_path)
    book = SentProgramBook(store.root / JOURNALS, site.controller.serial)
    recognised = IdentityCheck(site, site_path, store.root, clock)
    supervisor = Supervisor(site, clock, only=used, book=book, recognise=recognised)
    supervisor.trace_into(folder.path / "traces")
    road = supervisor.controller
    if isinstance(road, OfflineExchange):
        say("P-OFF-CARRY", folder=str(road.stick / "carry"), back=str(road.stick / "back"))
    try:
        machine = await supervisor.open_all()
        folder.set_state("opened", machine=machine)
        if isinstance(supervisor.controller, SendsPrograms):
            supervisor.controller.attend(origin_of(site), _ProgramArchive(folder).keep)
        if isinstance(supervisor.controller, SaysMotion):
            supervisor.controller.keep_to(site.moves.places)
        if isinstance(supervisor.controller, WritesWithout):
            supervisor.controller.do_without(SelfTestBook(store.root).without(machine))
        count = len(supervisor.picture())
        DevicesOpened(site.site.name, machine.serial, count, folder.run_id).tell(say)
        _report_identity(recognised, say)
        if wire := supervisor.controller.capabilities.unprotected:
            ConnectionUnprotected(wire).tell(say)
        if not supervisor.left.clear:
            say("P-LEFT", words=supervisor.left.said.message)
        yield RunContext(
            site=site,
            site_path=site_path,
            supervisor=supervisor,
            machine=machine,
            folder=folder,
            store=store,
            proofs=ProofBook(store.root),
            clock=clock,
            say=say,
            accepted=recognised.accepted,
        )
        set_aside_carried_files(supervisor.controller)
    except (TrueflankError, asyncio.CancelledError) as error:
        await shut_down(supervisor, folder, store=store, clock=clock, say=say, why=error)
        if isinstance(error, TrueflankError):
            with contextlib.suppress(TrueflankError):
                set_aside_carried_files(supervisor.controller)
        raise
    finally:
        with stopping.current().leaving():
            await supervisor.close_all()
        folder.adopt(*(folder.path / "traces").glob("*"))


def _report_identity(recognised: IdentityCheck, say: Say) -> None:
    """What was read of the machine for the first time, and what a person accepted of it."""
    if recognised.first:
        say("P-IDENTITY-FIRST", facts="; ".join(f"{one.fact} {one.value}" for one in recognised.first))
    for one in recognised.accepted:
        say("P-IDENTITY-ACCEPTED", **one.fields)


def set_aside_carried_files(controller: Controller) -> None:
    """Work with a control that files are carried to has ended: they are set aside. Raises ConfigError."""
    if isinstance(controller, OfflineExchange):
        controller.conclude()


SENT = "sent-"


class _ProgramArchive:
    """Every program that is sent, in the run folder, numbered in order; one that cannot be kept is not sent."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._count = sum(1 for name in folder.files if name.startswith(SENT))

    def keep(self, program: ProgramText) -> None:
        """Raises StoreError."""
        self._count += 1
        self._folder.write_text(f"{SENT}{self._count:03}-{program.file_name}", program.text)


# How a run leaves the machine: what it sent is asked to end, its words are given back, and what is left is told.

# Of the 30 s that a stop may take; the rest is for closing the devices.
WITHDRAW_S = 20.0
STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class LeftoverFinding:
    """Something of ours that an earlier gateway left in the control, before and after it was asked to end."""

    found: StaleProgram
    after: StaleProgram | None = None
    still_on: ClassVar[bool] = False

    @property
    def action(self) -> str:
        """What is offered."""
        now = self.found if self.after is None else self.after
        return "none" if now.clear else "end"

    @property
    def stands(self) -> bool:
        """Whether it was asked to end and is still there: a person at the control ends it."""
        return self.after is not None and not self.after.clear

    @property
    def words(self) -> str:
        """The finding as people read it."""
        return self.found.words if self.after is None else self.after.words

    @property
    def said(self) -> tuple[Message, ...]:
        """The finding: what is left, and what to press."""
        left = self.found if self.after is None else self.after
        return (left.said.message,)

    @property
    def said_at_last(self) -> tuple[Message, ...]:
        """How it stands now."""
        return self.said

    @property
    def at_last(self) -> str:
        """How it stands now."""
        return self.words

    def as_data(self) -> dict[str, Any]:
        """The finding as JSON data."""
        now = self.found if self.after is None else self.after
        return {"left_over": now.as_data(), "action": self.action, "what": self.words}


async def shut_down(
    supervisor: Supervisor, folder: RunFolder, store: Store, clock: Clock, say: Say, why: BaseException
) -> None:
    """After a failure or a stop: end what was sent, within `WITHDRAW_S`, and say what a person must press."""
    stop = stopping.current()
    with stop.leaving():
        left = await withdraw(supervisor)
        was_stopped = isinstance(why, asyncio.CancelledError)
        if left.kind != "nothing" and (was_stopped or not left.clear):
            stop.tell(left.sentence)
            if not was_stopped:  # else the last word of the command says it
                say("P-LEFT", words=left.said.message)
        if was_stopped:
            _record_stop(folder, store, clock, say, stop, left)


async def withdraw(supervisor: Supervisor) -> StaleProgram:
    """What is left after it was asked to end."""
    controller = supervisor.controller
    return await controller.withdraw(WITHDRAW_S) if isinstance(controller, LeavesPrograms) else NOTHING


def _record_stop(
    folder: RunFolder, store: Store, clock: Clock, say: Say, stop: stopping.StopAsked, left: StaleProgram
) -> None:
    """The run's state, and for each transaction that was cut short the end of its audit record."""
    try:
        folder.set_state(STOPPED, error=stop.error().as_record())
    except TrueflankError as error:
        stop.tell(str(error))
    told = {"run": folder.run_id, "by": stop.by, "left": left.words}
    for number in stop.transactions:
        problem = audit.note(store.root, "push-stopped", clock=clock, transaction=number, details=told)
        if problem:
            say("P-AUDIT", problem=problem)
    stop.transactions.clear()


async def clear_leftovers(supervisor: Supervisor, timeout_s: float) -> StaleProgram:
    """End it; ``timeout_s`` is the time for a person to press what was said."""
    controller = supervisor.controller
    return await controller.clear_left_over(timeout_s) if isinstance(controller, LeavesPrograms) else NOTHING
