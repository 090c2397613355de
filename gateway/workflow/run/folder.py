"""A stored run and its site: where its runs lie, the site as a run kept it, its machine, whether a double took part.

It opens no device and knows no push: whoever reads a run needs no more than this.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Protocol

from drivers.errors import ConfigError
from drivers.local.scrub import without_secrets_text
from drivers.programs import Origin
from drivers.types.identity import Identity
from gateway.config import SiteFile, load_site
from gateway.domain.equipment import Equipment
from gateway.domain.identity import KnownMachine, known_machine
from gateway.errors import StoreError
from gateway.store import MEASURES, RunFolder, Store
from gateway.store.machine_books import IdentityBook
from gateway.workflow.run import stages
from gateway.workflow.run.stages import DOUBLE

KEPT = "site.toml"
Utc = Callable[[], datetime]


def store_of(site: SiteFile, site_path: Path, utc: Utc | None = None) -> Store:
    """The site's store: its folder is relative to the site file. ``utc`` names new runs, else the wall."""
    root = (site_path.parent / site.site.store).resolve()
    return Store(root) if utc is None else Store(root, utc)


def stated_by(site: SiteFile) -> dict[str, str]:
    """The facts that the site file states."""
    return {"serial": site.controller.serial, **site.controller.identity.facts}


def known_of(site: SiteFile, root: Path) -> KnownMachine:
    """What the site's machine is known by, with what a person accepted. Raises as `IdentityBook.all`."""
    return known_machine(stated_by(site), IdentityBook(root).all(site.controller.serial))


def origin_of(site: SiteFile) -> Origin:
    """In whose name this site's programs are sent."""
    return Origin(site.site.name, site.controller.serial, metadata.version("trueflank"))


def new_run(
    site: SiteFile, site_path: Path, store: Store | None = None, *, measures: bool = True, utc: Utc | None = None
) -> RunFolder:
    """A run folder that remembers the site file: its path and its text as it was, without any secret.

    In the site's store, or in another one. The path is seen from the run's own folder, so that no record tells how this
    computer's folders are called; a folder for a short time may be elsewhere, and tells the whole. One that can measure
    nothing (not ``measures``) is never the latest.
    """
    path = site_path.resolve()
    told = str(path) if store is not None else _from_run(path, store_of(site, site_path).root)
    plan = {"site_file": told} if measures else {"site_file": told, MEASURES: False}
    folder = (store or store_of(site, site_path, utc)).create(site.site.name, plan)
    folder.write_text(KEPT, without_secrets_text(site_path.read_text(encoding="utf-8")))
    return folder


def _from_run(path: Path, root: Path) -> str:
    """A path as the runs of a store see it; whole where no way leads there (another drive)."""
    try:
        return Path(os.path.relpath(path, root / "run")).as_posix()
    except ValueError:
        return str(path)


def site_path_of(folder: RunFolder) -> Path | None:
    """Where the site file of a stored run lies; None where the run was made without one."""
    plan = folder.plan
    told = str(plan["site_file"]) if isinstance(plan, Mapping) and plan.get("site_file") else ""
    return (folder.path / told).resolve() if told else None


def site_of(folder: RunFolder) -> tuple[SiteFile, Path]:
    """The site a stored run was made at, read afresh. Raises ConfigError when its file is gone or wrong."""
    path = site_path_of(folder)
    if path is None:
        raise ConfigError("E-RUN-NO-SITE", str(folder.path))
    return load_site(path), path


def site_recorded(folder: RunFolder) -> tuple[SiteFile, Path]:
    """The site as the run itself kept it, with the path it had: a report needs nothing beside its run.

    A copy that today's rules refuse gives way to the file it was made from. Raises as `site_of`.
    """
    path = site_path_of(folder)
    try:
        return load_site(folder.path / KEPT), path or folder.path / KEPT
    except ConfigError:
        return site_of(folder)


class Heard(Protocol):
    """A device of a run: who it said it is, and what it cannot see."""

    @property
    def identity(self) -> Identity:
        """Who it said it is."""
        ...

    @property
    def notices(self) -> tuple[str, ...]:
        """What it cannot see."""
        ...


def was_simulated(site: SiteFile, devices: Iterable[Heard]) -> bool:
    """Whether a double was in the loop: by the site file, or by the word of any device itself."""
    return site.site.simulated or any(_says_so(one) for one in devices)


def _says_so(one: Heard) -> bool:
    return any(DOUBLE in text.lower() for text in (one.identity.model, *one.identity.notes, *one.notices))


def simulated_run(folder: RunFolder) -> bool:
    """The same of a stored run; one made without a site, from a file, says it in the file's own words."""
    try:
        site, _ = site_recorded(folder)
    except (ConfigError, StoreError):
        return False
    devices = folder.get(stages.EQUIPMENT, Equipment).items if folder.has(stages.EQUIPMENT) else ()
    return was_simulated(site, devices)
