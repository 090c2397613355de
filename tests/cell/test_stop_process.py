"""A real process of `trueflank run` in mid-push beside a machine that goes on: ended by SIGTERM, and by kill -9."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from gateway.workflow.run.folder import store_of
from tests.cell.stops import INTERRUPTED, RESET, Shop, shop, table_of

SPEED = 60.0
# What is waited for comes in a second or two; a machine with other work to do may take a while.
WAIT_S = 120.0
RELEASE = 89

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="its stops are console events, which need a console")


async def _until(condition: Callable[[], bool], what: str) -> None:
    wall = LoopClock()
    async with wall.deadline(WAIT_S, what):
        while not condition():
            await wall.sleep(0.02)


@contextlib.asynccontextmanager
async def released(folder: Path) -> AsyncIterator[tuple[Shop, asyncio.subprocess.Process]]:
    """A child that has released its table; the program stands at M0, and nobody restarts the control."""
    async with shop(folder, LoopClock(SPEED), activate_delay_s=1e6) as at:
        words = ["-m", "gateway.cli", "run", str(at.path), "--apply", "--machine", at.site.site.name]
        pipes = {"stdout": asyncio.subprocess.PIPE, "stderr": asyncio.subprocess.PIPE}
        child = await asyncio.create_subprocess_exec(sys.executable, *words, **pipes)
        try:
            await _until(lambda: at.channel == INTERRUPTED and at.cell.nck.get(f"R[{RELEASE}]") != 0.0, "the release")
            yield at, child
        finally:
            if child.returncode is None:
                child.kill()
            await child.communicate()


def test_sigterm_in_mid_push_takes_the_release_back_and_says_what_to_press(tmp_path: Path) -> None:
    async def main() -> None:
        async with released(tmp_path) as (at, child):
            child.send_signal(signal.SIGTERM)
            out, err = await child.communicate()
            said = (out + err).decode()
            assert child.returncode == 143, said
            assert "SIGTERM" in said
            assert "is stopped with a request to end" in said
            assert "W-LEFT" not in said
            assert "press RESET" in said
            assert [one.kinds[-1] for one in at.journal()] == ["STOPPED"]
            audit = (store_of(at.site, at.path).root / "audit" / "audit-000001.jsonl").read_text()
            assert "push-stopped" in audit
            before = table_of(at.cell)
            at.cell.operator.press("NC START")  # the other button: nothing may be switched by it
            await _until(lambda: at.channel == RESET, "the end of the program")
            assert table_of(at.cell) == before
            points, on = before
            assert on, "what was released was switched on before, and is told of"
            assert any(points)
            assert "ENABLE" in at.journal()[0].kinds

    asyncio.run(main())


@pytest.mark.soak
def test_kill_in_mid_push_is_known_by_its_number(tmp_path: Path) -> None:
    async def main() -> None:
        async with released(tmp_path) as (at, child):
            child.kill()
            await child.wait()
            assert child.returncode == -signal.SIGKILL
            left, codes = await at.page()
            assert left.kind == "stopped"
            assert left.number == at.journal()[0].number
            assert set(codes) == {"W-LEFT-STOPPED", "R-HELD-UNKNOWN"}

    asyncio.run(main())
