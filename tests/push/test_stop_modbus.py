"""A stop in mid-push on the road with a mailbox: noted, the session ended, nothing switched on by a late button."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from gateway.push import push_table, unfinished_tables
from gateway.stopping import StopAsked, Stopped, obey
from tests.push.world import Scene, change_of, context_for, world


@pytest.mark.parametrize("after_s", [2.2, 12.0])
async def test_a_stop_ends_the_session_and_the_panels_button_does_nothing(tmp_path: Path, after_s: float) -> None:
    clock, scene, stop = LoopClock(), Scene(), StopAsked()
    async with world(scene, clock) as at:
        at.person.confirms = False
        device = at.driver()
        await device.open(5.0)
        base = await device.saved_tables("X1")
        context = context_for(scene, device, clock, tmp_path, await device.identify())
        asyncio.get_running_loop().call_later(after_s, stop.ask, "SIGTERM")
        with pytest.raises(Stopped) as caught:
            await obey(push_table(change_of(scene, base), context), stop, clock)
        assert "SIGTERM" in caught.value.what
        left = await device.withdraw(5.0)
        assert left.kind == "closed"
        assert left.clear
        await device.close()
        (found,) = unfinished_tables(context.journals, context.machine.serial)
        assert found.kinds[-1] == "STOPPED"
        assert stop.transactions == [found.number]
        at.station.plc.confirm()
        await clock.sleep(30.0)
        assert at.station.plc.session == 0
        assert at.oracle.off or at.oracle.as_before
        assert not at.oracle.broken
