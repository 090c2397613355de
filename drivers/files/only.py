"""No control at all: a site whose owner brings result files and carries tables by hand. Nothing is ever connected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from drivers.checks import CheckLine, Wanted, fine
from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.settings import DriverSettings

NAME, ADDRESS = "none", "none://"


class FilesOnlySettings(DriverSettings):
    """Driver "none" has no settings: there is nothing to connect to."""

    addresses: ClassVar[tuple[str, ...]] = ("none",)


class FilesOnly:
    """Driver "none": made for any command that needs a control, it says at once that there is none."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        """Always raises ConfigError (E-FILES-ONLY)."""
        del url, settings, clock
        raise ConfigError("E-FILES-ONLY", name)


class FilesOnlyDoctor:
    """What such a site can do; there is no connection to look at."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        del name, url, settings, clock

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """One line, the same for every site."""
        del wanted, timeout_s
        return (fine("W-FILES-ONLY", "connection"),)
