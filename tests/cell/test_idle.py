"""Instruments that nobody measures with: they are heard, and one that is gone is noticed and taken back."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

from drivers.clock import LoopClock
from drivers.types.sensing import SampleBlock
from gateway.config import load_site
from gateway.live import Nobody, looked_on_by
from gateway.supervisor import Supervisor
from tests.selftested import cell_running


@dataclass
class Listening(Nobody):
    """Counts what each instrument sent."""

    counted: dict[str, int] = field(default_factory=dict)

    def samples(self, instrument: str, block: SampleBlock) -> None:
        """What an instrument has just sent."""
        self.counted[instrument] = self.counted.get(instrument, 0) + len(block)


async def test_an_idle_instrument_is_heard_and_one_that_is_gone_is_noticed_and_taken_back(tmp_path: Path) -> None:
    clock, page, stop = LoopClock(), Listening(), asyncio.Event()
    async with cell_running("demo", tmp_path / "cell", clock, wires="memory", block_s=0.5) as cell:
        site = load_site(cell.site_path)
        few = [one for one in site.instruments if one.name in ("laser", "calibrator")]
        devices = Supervisor(site.model_copy(update={"instruments": few}), clock)
        await devices.open_all()

        def states() -> dict[str, str]:
            return {one.name: one.state for one in devices.picture()}

        with looked_on_by(page):
            watch = asyncio.create_task(devices.watch(stop))
        await clock.sleep(4.0)
        instruments = set(states()) - {"controller"}
        assert set(page.counted) == instruments
        assert set(states().values()) == {"open"}
        cell.beam("calibrator", broken=True)
        await cell.pull("laser")
        await clock.sleep(4.0)
        assert states()["laser"] in ("lost", "failed"), "without anybody measuring with it"
        cell.beam("calibrator", broken=False)
        await cell.plug("laser")
        await clock.sleep(15.0)
        assert set(states().values()) == {"open"}
        page.counted.clear()
        await clock.sleep(4.0)
        assert set(page.counted) == instruments, "and is heard again"
        stop.set()
        await watch
        await devices.close_all()
