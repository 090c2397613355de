"""The bench a run works at: site, devices, store, clock and people's patience, opened together and closed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Collection, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory

from drivers.carried import Carried
from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.local.names import shown
from drivers.message import Message
from drivers.ports.controller import Controller
from drivers.programs import ForeseesPlans, ProgramText, SaysMotion, SendsPrograms, WritesWithout
from drivers.types.identity import MachineIdentity
from drivers.types.stops import StopPlan
from gateway import stopping
from gateway.axes import AxisRecord
from gateway.broker import borrowed
from gateway.capture.rig import Rig, StandingOptics
from gateway.config import AxisSection, SiteFile, files_only
from gateway.domain.identity import KnownFact
from gateway.errors import StoreError, WriteRefused
from gateway.events import ConnectionUnprotected, DevicesOpened
from gateway.push import JOURNALS, SentProgramBook
from gateway.say import Say
from gateway.store import RunFolder, Store
from gateway.store.proofs import Proofs
from gateway.store.selftests import SelfTestBook
from gateway.supervisor import Supervisor
from gateway.walk import Patience
from gateway.workflow.leaving import leave
from gateway.workflow.recognising import Recognising
from gateway.workflow.runsite import new_run, origin_of, store_of


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything a stage may use. ``machine`` is the fingerprint met when the devices were opened.

    ``accepted`` are changes of the machine's identity that a person answers for.
    """

    site: SiteFile
    site_path: Path
    supervisor: Supervisor
    machine: MachineIdentity
    folder: RunFolder
    store: Store
    proofs: Proofs
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
    def open_road(self) -> Message | str:
        """Why others on the network could read or change what passes to the control; "" where they cannot."""
        return self.supervisor.controller.capabilities.unprotected

    @property
    def moved(self) -> frozenset[str]:
        """Machine names of the axes that are moved and measured; every other stands still."""
        return frozenset(axis.name for axis in self.site.axes)


@contextmanager
def run_or_look(site: SiteFile, site_path: Path, state: str, *, look: bool) -> Iterator[RunFolder]:
    """The folder of a run that measures nothing and begins with ``state``; of a ``look`` one that goes with it.

    What stays of a look is its line in the audit log (`gateway.workflow.consents.looked`). Raises ConfigError
    (E-FILES-ONLY) before there is a folder.
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


def kept_in(at: Bench) -> str:
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
async def bench(
    site: SiteFile,
    site_path: Path,
    folder: RunFolder,
    clock: Clock,
    say: Say,
    instruments: Collection[str] | None = None,
) -> AsyncIterator[Bench]:
    """Open the controller and the instruments (all failures at once), hand out the bench, close everything at the end.

    While a gateway serves this site its devices are asked for first: raises what `gateway.broker.borrowed` raises.
    A failure or a stop leaves the machine in order first: what was sent is asked to end, and what is left is told.

    Without ``instruments`` those that measure the site's axes; others may stand in the site file unplugged.
    """
    root = store_of(site, site_path).root
    async with (
        borrowed(root, folder.run_id, clock, say) as told,
        _opened(site, site_path, folder=folder, clock=clock, say=told, instruments=instruments) as at,
    ):
        yield at


@asynccontextmanager
async def _opened(
    site: SiteFile,
    site_path: Path,
    folder: RunFolder,
    clock: Clock,
    say: Say,
    instruments: Collection[str] | None,
) -> AsyncIterator[Bench]:
    used = {axis.measure.instrument for axis in site.axes} if instruments is None else set(instruments)
    store = store_of(site, site_path)
    book = SentProgramBook(store.root / JOURNALS, site.controller.serial)
    recognised = Recognising(site, site_path, store.root, clock)
    supervisor = Supervisor(site, clock, only=used, book=book, recognise=recognised)
    supervisor.trace_into(folder.path / "traces")
    road = supervisor.controller
    if isinstance(road, Carried):
        say("P-OFF-CARRY", folder=str(road.stick / "carry"), back=str(road.stick / "back"))
    try:
        machine = await supervisor.open_all()
        folder.set_state("opened", machine=machine)
        if isinstance(supervisor.controller, SendsPrograms):
            supervisor.controller.attend(origin_of(site), _Kept(folder).keep)
        if isinstance(supervisor.controller, SaysMotion):
            supervisor.controller.keep_to(site.moves.places)
        if isinstance(supervisor.controller, WritesWithout):
            supervisor.controller.do_without(SelfTestBook(store.root).without(machine))
        count = len(supervisor.picture())
        DevicesOpened(site.site.name, machine.serial, count, folder.run_id).tell(say)
        _tell_identity(recognised, say)
        if wire := supervisor.controller.capabilities.unprotected:
            ConnectionUnprotected(wire).tell(say)
        if not supervisor.left.clear:
            say("P-LEFT", words=supervisor.left.said.message)
        yield Bench(
            site=site,
            site_path=site_path,
            supervisor=supervisor,
            machine=machine,
            folder=folder,
            store=store,
            proofs=Proofs(store.root),
            clock=clock,
            say=say,
            accepted=recognised.accepted,
        )
        conclude(supervisor.controller)
    except (TrueflankError, asyncio.CancelledError) as error:
        await leave(supervisor, folder, store=store, clock=clock, say=say, why=error)
        if isinstance(error, TrueflankError):
            with contextlib.suppress(TrueflankError):
                conclude(supervisor.controller)
        raise
    finally:
        with stopping.current().leaving():
            await supervisor.close_all()
        folder.adopt(*(folder.path / "traces").glob("*"))


def _tell_identity(recognised: Recognising, say: Say) -> None:
    """What was read of the machine for the first time, and what a person accepted of it."""
    if recognised.first:
        say("P-IDENTITY-FIRST", facts="; ".join(f"{one.fact} {one.value}" for one in recognised.first))
    for one in recognised.accepted:
        say("P-IDENTITY-ACCEPTED", **one.fields)


def conclude(controller: Controller) -> None:
    """Work with a control that files are carried to has ended: they are set aside. Raises ConfigError."""
    if isinstance(controller, Carried):
        controller.conclude()


SENT = "sent-"


class _Kept:
    """Every program that is sent, in the run folder, numbered in order; one that cannot be kept is not sent."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._count = sum(1 for name in folder.files if name.startswith(SENT))

    def keep(self, program: ProgramText) -> None:
        """Raises StoreError."""
        self._count += 1
        self._folder.write_text(f"{SENT}{self._count:03}-{program.file_name}", program.text)
