"""Whether a double stood in for the machine or an instrument: by the site file, by a device's word, by a file's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from drivers.errors import ConfigError
from drivers.types.identity import Identity
from drivers.types.results import MeasuredSet
from gateway.config import SiteFile
from gateway.domain.equipment import Equipment
from gateway.errors import StoreError
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.bench import site_recorded

DOUBLE = "simulated"
SAID = "SIMULATED: a simulated device took part; this is no measurement of a real machine"


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


def simulated_set(measured: MeasuredSet) -> bool:
    """Whether a result file's own words name a double, as every file that is exported from such a run does."""
    return any(DOUBLE in text.lower() for text in measured.header.values())
