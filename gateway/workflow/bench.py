"""The bench a run works at: site, devices, store, clock and people's patience, opened together and closed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.local.scrub import without_secrets_text
from drivers.programs import Origin, ProgramText, SendsPrograms
from drivers.types.identity import MachineIdentity
from gateway import stopping
from gateway.capture.rig import Rig
from gateway.config import AxisSection, SiteFile, load_site
from gateway.errors import WriteRefused
from gateway.push.records.journal import JOURNALS
from gateway.push.records.sent import SentBook
from gateway.say import Say
from gateway.store import Proofs, RunFolder, Store
from gateway.supervisor import Supervisor
from gateway.walk import Patience
from gateway.workflow.leaving import leave


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything a stage may use. ``machine`` is the fingerprint met when the devices were opened."""

    site: SiteFile
    site_path: Path
    supervisor: Supervisor
    machine: MachineIdentity
    folder: RunFolder
    store: Store
    proofs: Proofs
    clock: Clock
    say: Say

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

    def axis(self, name: str) -> AxisSection:
        """An axis of the site by its machine name."""
        for axis in self.site.axes:
            if axis.name == name:
                return axis
        known = ", ".join(axis.name for axis in self.site.axes)
        raise ConfigError("E-RUN-AXIS", str(self.site_path), axis=name, known=known)

    @property
    def moved(self) -> frozenset[str]:
        """Machine names of the axes that are moved and measured; every other stands still."""
        return frozenset(axis.name for axis in self.site.axes)


def store_of(site: SiteFile, site_path: Path) -> Store:
    """The site's store: its folder is relative to the site file."""
    return Store((site_path.parent / site.site.store).resolve())


def new_run(site: SiteFile, site_path: Path) -> RunFolder:
    """A run folder that remembers the site file: its path and its text as it was, without any secret."""
    folder = store_of(site, site_path).create(site.site.name, {"site_file": str(site_path.resolve())})
    folder.write_text("site.toml", without_secrets_text(site_path.read_text(encoding="utf-8")))
    return folder


def site_of(folder: RunFolder) -> tuple[SiteFile, Path]:
    """The site a stored run was made at, read afresh. Raises ConfigError when its file is gone or wrong."""
    path = Path(str(folder.plan["site_file"]))
    return load_site(path), path


def check_name(site: SiteFile, apply: bool, machine_name: str) -> None:
    """Consent names the machine. Raises WriteRefused (E-RUN-NAME)."""
    if apply and machine_name != site.site.name:
        raise WriteRefused("E-RUN-NAME", "--machine", typed=machine_name or "(nothing)", name=site.site.name)


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

    A failure or a stop leaves the machine in order first: what was sent is asked to end, and what is left is told.

    Without ``instruments`` those that measure the site's axes; others may stand in the site file unplugged.
    """
    used = {axis.measure.instrument for axis in site.axes} if instruments is None else set(instruments)
    store = store_of(site, site_path)
    supervisor = Supervisor(site, clock, only=used, book=SentBook(store.root / JOURNALS, site.controller.serial))
    supervisor.trace_into(folder.path / "traces")
    try:
        machine = await supervisor.open_all()
        folder.set_state("opened", machine=machine)
        if isinstance(supervisor.controller, SendsPrograms):
            supervisor.controller.attend(origin_of(site, folder.run_id), _Kept(folder).keep)
        say("P-OPEN", site=site.site.name, serial=machine.serial, count=len(supervisor.picture()))
        if not supervisor.left.clear:
            say("P-LEFT", words=supervisor.left.words)
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
        )
    except (TrueflankError, asyncio.CancelledError) as error:
        await leave(supervisor, folder, store=store, clock=clock, say=say, why=error)
        raise
    finally:
        with stopping.current().leaving():
            await supervisor.close_all()
        folder.adopt(*(folder.path / "traces").glob("*"))


def origin_of(site: SiteFile, run: str = "") -> Origin:
    """In whose name this site's programs are sent."""
    return Origin(site.site.name, site.controller.serial, run, metadata.version("trueflank"))


SENT = "sent-"


class _Kept:
    """Every program that is sent, in the run folder, numbered in order; one that cannot be kept is not sent."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._count = sum(1 for _ in folder.path.glob(f"{SENT}*"))

    def keep(self, program: ProgramText) -> None:
        """Raises StoreError."""
        self._count += 1
        self._folder.write_text(f"{SENT}{self._count:03}-{program.file_name}", program.text)
