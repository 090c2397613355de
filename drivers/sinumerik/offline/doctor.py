"""The doctor of a road without a wire: what the control said of itself when it was seen last; it carries nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.checks import CheckLine, Wanted, failed, identity_lines, unknown
from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.sinumerik.offline import answering
from drivers.sinumerik.offline.folder import StepFolder
from drivers.sinumerik.offline.report import ReportAsked
from drivers.sinumerik.offline.settings import OfflineSettings
from drivers.sinumerik.opcua.settings import UaSettings


class OfflineDoctor:
    """Settings as the controller's; it reads the folder alone."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        del url, clock
        own = OfflineSettings.read(settings, name)
        self._where = name
        self._folder = StepFolder(Path(own.folder), name)
        self._asked = ReportAsked(own.names, own.cross_tables, UaSettings.read(own.road, name).words, own.r_marker)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """The folder, and the last report against what the site expects. Never raises our errors."""
        del timeout_s
        try:
            self._folder.prepare()
            last = self._folder.newest()
            if last is None:
                return (unknown("W-OFF-UNSEEN", "road"),)
            image = answering.image_of(last, self._asked, self._where)
        except TrueflankError as error:
            return (failed(error, "road"),)
        return (*identity_lines(image.machine, wanted), unknown("W-OFF-ROAD", "road"))
