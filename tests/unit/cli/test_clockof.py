"""Whose clock a command goes by: that of a simulated cell which keeps one, and the system's in any other case."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.clock import HostedTimeLoop, JoinedTimeLoop, LoopClock
from gateway.cli.signals import loop_factory, run_to_end

END_S = 10.0


@contextmanager
def kept(site: Path, text: str = '[site]\nname = "demo"\nsimulated = true\n') -> Iterator[None]:
    """A site file, and beside it what a cell says that keeps a clock."""
    up, over = threading.Event(), asyncio.Event()
    loop = HostedTimeLoop()

    async def main() -> None:
        with loop.keeping_up():
            up.set()
            await over.wait()

    def run() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(main())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert up.wait(END_S)
    site.write_text(text, encoding="utf-8")
    site.with_suffix(".cell.json").write_text(json.dumps({"clock": loop.address}), encoding="utf-8")
    try:
        yield
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join(END_S)


async def _a_day() -> tuple[bool, float]:
    clock = LoopClock()
    began = clock.now()
    await clock.sleep(86400.0)
    return isinstance(asyncio.get_running_loop(), JoinedTimeLoop), clock.now() - began


def test_a_day_at_a_simulated_machine_passes_at_once(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    with kept(site):
        assert run_to_end(_a_day(), at=site) == (True, 86400.0)


async def _whose() -> type:
    return type(asyncio.get_running_loop())


@pytest.mark.parametrize("text", ['[site]\nname = "grinder"\n', '[site]\nsimulated = "yes"\n', "[site", "site = 1\n"])
def test_a_real_machine_goes_by_the_systems_clock(tmp_path: Path, text: str) -> None:
    site = tmp_path / "site.toml"
    with kept(site, text):
        assert loop_factory(site) is None


def test_where_nobody_keeps_a_clock_the_systems_is_there(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    with kept(site):
        pass
    assert loop_factory(site) is not None
    assert not issubclass(run_to_end(_whose(), at=site), JoinedTimeLoop)
    site.with_suffix(".cell.json").write_text('{"speed": 20}', encoding="utf-8")
    assert loop_factory(site) is None
    assert loop_factory(None) is None
