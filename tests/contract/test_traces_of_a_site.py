"""A site that wants traces: the supervisor keeps every instrument's wire, and what it kept can be played again."""

from __future__ import annotations

from contextlib import aclosing
from pathlib import Path
from typing import Any

import pytest

from drivers import registry
from drivers.clock import LoopClock
from drivers.replay.player import Player
from drivers.transport import serve
from gateway.config import SiteFile
from gateway.supervisor import DevicesFailed, Supervisor
from tests.contract.servers import ScriptedUmd
from tests.unit.drivers.loops import run_clean

AXIS = {
    "name": "X1", "letter": "X", "kind": "linear", "travel": [0.0, 100.0],
    "measure": {"instrument": "laser", "component": "EXX", "feed": 1000.0, "stable": 0.1,
                "targets": {"positions": [0.0, 50.0, 100.0]}},
    "table": {"minimum": 0.0, "maximum": 100.0, "step": 10.0},
}  # fmt: skip


def site(url: str, *, trace: bool) -> SiteFile:
    data: dict[str, Any] = {
        "site": {"name": "bench", "trace": trace},
        "controller": {"url": "opc.tcp://127.0.0.1:1", "serial": "1", "settings": {"server_certificate": "none.der"}},
        "instruments": [{"name": "laser", "driver": "umd", "url": url, "settings": {"axis": 1}}],
        "axes": [AXIS],
    }
    return SiteFile.model_validate(data)


@pytest.mark.parametrize("trace", [True, False])
def test_traces_are_kept_where_the_site_wants_them(tmp_path: Path, trace: bool) -> None:
    folder = tmp_path / "traces"

    async def main() -> None:
        clock = LoopClock()
        listener = await serve("memory://laser", ScriptedUmd(clock).converse, clock)
        supervisor = Supervisor(site(listener.url, trace=trace), clock)
        supervisor.trace_into(folder)
        with pytest.raises(DevicesFailed):  # there is no control on this bench
            await supervisor.open_all()
        async with aclosing(supervisor.instrument("laser").blocks()) as stream:  # type: ignore[type-var]
            await anext(stream)
        await supervisor.close_all()
        await listener.close()

    run_clean(main, virtual=True)
    assert folder.exists() is trace
    if trace:
        player = Player(folder / "laser.trace")
        assert (player.driver, player.settings) == ("umd", {"axis": 1})
        found = player.play(registry.load("umd", "instrument"), player.settings)
        assert found.samples == 20
        assert found.identity is not None
        assert found.identity.firmware == "1.26"
