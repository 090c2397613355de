"""A small machine without a wire: the double, the person who carries files, and the judge of its memory."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.sinumerik.offline.device import SinumerikOffline
from drivers.types.tables import CompensationTable, LiveTable
from simulators.nck import Nck, NckSpec
from simulators.nck.machine.data import ENC_ENABLE
from simulators.operator import OfflineOperator
from tests.placed import placed
from tests.push.oracle import Oracle, content_of
from tests.push.uaworld import X_SPEC, Z_SPEC
from tests.push.world import NEW, OLD

URL = "carried://stick"
BEFORE = LiveTable(OLD, True)


class OfflineWorld:
    """One machine, its porter, and the folder that he carries."""

    def __init__(self, nck: Nck, clock: Clock, folder: Path, old: LiveTable, new: CompensationTable) -> None:
        self.nck, self.clock, self.folder, self.new = nck, clock, folder, new
        self.porter = OfflineOperator(nck, clock, folder)
        self.oracle = Oracle(nck, old, new)

    def driver(self) -> SinumerikOffline:
        """A driver at this folder, as a new process makes it."""
        axes = " ".join(axis.name for axis in self.nck.spec.axes)
        return placed(SinumerikOffline("840D", URL, {"folder": str(self.folder), "axes": axes}, self.clock))

    @property
    def sheet(self) -> str:
        """What is to be carried now; "" for nothing."""
        path = self.folder / "carry" / "SHEET.txt"
        return path.read_text(encoding="utf-8") if path.exists() else ""


@contextlib.asynccontextmanager
async def offline_world(
    clock: Clock, folder: Path, new: CompensationTable = NEW, old: LiveTable | None = BEFORE, **switches: Any
) -> AsyncIterator[OfflineWorld]:
    """A machine that is switched on, referenced, in AUTO, with the old table live; None: it holds nothing yet."""
    spec = NckSpec((X_SPEC, Z_SPEC))
    nck = Nck(replace(spec, access_level=2, files_max_bytes=65536, **switches), clock)
    if old is not None:
        held: Any = nck.core.memory.eec[0, 0]
        content = content_of(old.table, len(held.points))
        held.points = list(content.points)
        held.minimum, held.maximum, held.step, held.is_modulo = content.shape
    await nck.start()
    nck.core.data.store(ENC_ENABLE, (0, 0), old is not None and old.enabled)
    nck.core.newconf()
    made = OfflineWorld(nck, clock, folder, old or BEFORE, new)
    await made.porter.ready()
    try:
        yield made
    finally:
        await nck.stop()
