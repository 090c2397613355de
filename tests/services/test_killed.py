"""The service killed -9 at random moments of runs and pushes beside a machine that goes on.

What must hold after each: every record that was there can be read, nothing is written by the new start, and its first
picture says that recovery is needed. `make services` kills it ten times, `make soak` and `make attacks` a hundred.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded
from gateway import audit
from gateway.broker.state_folder import token_path
from gateway.store import RunFolder, Store
from gateway.workflow.run.folder import store_of
from tests.cell.stops import INTERRUPTED, Shop, shop, table_of

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kill -9, and /proc")
SPEED, WAIT_S = 120.0, 90.0
# 1.5 to 2 s here; how fast a computer is decides nothing: only a start that hangs is a failure.
HANGS_S = 60.0
STARTS = Path(__file__).with_name("starts.py")


@dataclass
class Life:
    """One service process and its page; ``took_s`` is how long after the start its ``first`` picture was there.

    Of that time, other programs' turns are taken off: the simulated machine beside it among them.
    """

    client: httpx.AsyncClient
    at: str
    first: dict[str, Any]
    took_s: float

    async def ask(self, path: str) -> Any:
        return (await self.client.get(self.at + path)).json()

    async def give(self, command: str, **body: object) -> dict[str, Any]:
        answer = await self.client.post(f"{self.at}/commands/{command}", json=body)
        assert answer.status_code == 202, answer.text
        return dict(answer.json())

    async def ended(self, number: int) -> dict[str, Any]:
        while True:
            job = dict(await self.ask(f"/jobs/{number}"))
            if job["state"] != "running":
                return job
            await LoopClock().sleep(0.1)


@asynccontextmanager
async def living(at: Shop) -> AsyncIterator[Life]:
    """A service begun and looked at; killed -9 at the end."""
    root, name = store_of(at.site, at.path).root, at.site.site.name
    token, pid = token_path(root), 0
    log = (at.path.parent / "serve.log").open("ab")
    words = [str(STARTS), str(at.path), str(token), name]
    starter = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE, stderr=log)
    assert starter.stdout is not None
    try:
        told = json.loads(await starter.stdout.readline())
        pid, took_s = told["pid"], told["took_s"] - told["waited_s"]
        head = {"Authorization": f"Bearer {token.read_text(encoding='ascii').strip()}"}
        async with httpx.AsyncClient(base_url=told["url"], headers=head, trust_env=False, timeout=300.0) as client:
            yield Life(client, f"/api/v1/sites/{name}", told["first"], took_s)
    finally:
        if pid:
            os.kill(pid, signal.SIGKILL)
        await starter.wait()
        log.close()


@dataclass
class Seen:
    """What was kept before the kill, for comparing."""

    stages: dict[str, set[str]] = field(default_factory=dict)
    audit: int = 0
    starts_s: list[float] = field(default_factory=list)
    held: int = 0
    pushes: int = 0
    states: list[str] = field(default_factory=list)


def kept(store: Store, seen: Seen) -> None:
    """Everything that was there is there, and can be read."""
    now: dict[str, set[str]] = {}
    for run in store.runs():
        assert not run.problem, run.problem
        folder = RunFolder(run.path)
        now[run.run_id] = set(folder.stages)
        for stage in folder.stages:
            folder.envelope(stage)
    for run_id, stages in seen.stages.items():
        assert stages <= now[run_id], run_id
    records = list(audit.read_entries(store.root))
    assert not [one for one in records if one["damaged"]]
    assert len(records) >= seen.audit
    seen.stages, seen.audit = now, len(records)


async def settled(at: Shop) -> Any:
    """The table once the machine does nothing more by itself."""
    before = None
    while (now := (table_of(at.cell), at.channel, at.program)) != before:
        before = now
        await LoopClock().sleep(0.5)
    return table_of(at.cell)


async def helped(at: Shop) -> None:
    """A person at the machine: presses RESET where a stopped program stands for long."""
    since = 0.0
    while True:
        await LoopClock().sleep(0.25)
        since = since + 0.25 if at.channel == INTERRUPTED else 0.0
        if since >= 3.0:
            at.cell.operator.press("RESET")
            since = 0.0


async def one_life(at: Shop, store: Store, seen: Seen, chance: random.Random) -> None:
    """Start, look, put right what was left, begin something, and kill it."""
    before = await settled(at)
    open_pushes = at.journal()
    async with living(at) as life:
        seen.starts_s.append(life.took_s)
        if open_pushes:
            seen.held += 1
            assert life.first["held"], "recovery is needed, and not said"
            assert life.first["state"] in ("attention", "still-on")
        await LoopClock().sleep(0.5)
        assert table_of(at.cell) == before, "a start wrote by itself"
        assert len(at.journal()) == len(open_pushes)
        kept(store, seen)
        if open_pushes:
            person = asyncio.create_task(helped(at))
            job = await life.give("recover", apply=True, machine=at.site.site.name)
            with suppress(DeadlineExceeded):
                async with LoopClock().deadline(chance.choice((0.3, WAIT_S)), "recover"):
                    seen.states.append(f"recover {(await life.ended(job['job']))['state']}")
            person.cancel()
            await asyncio.gather(person, return_exceptions=True)
            return
        runs = [run.run_id for run in store.runs() if "proposal" in RunFolder(run.path).stages]
        if runs and chance.random() < 0.75:
            seen.pushes += 1
            job = await life.give("push", run=runs[-1], apply=True, machine=at.site.site.name)
        else:
            job = await life.give("run")
        with suppress(DeadlineExceeded):
            async with LoopClock().deadline(chance.uniform(0.1, 6.0) if runs else WAIT_S, "work"):
                done = await life.ended(job["job"])
                seen.states.append(f"{done['kind']} {done['state']} {(done['error'] or {}).get('code', '')}")


# Ten by `make services`, a hundred by `make soak` and `make attacks`, at other moments.
FEW = pytest.param(10, 20261123, marks=[pytest.mark.services, pytest.mark.timeout(1200)])
MANY = pytest.param(
    100,
    20261124,
    marks=[
        pytest.mark.soak,
        pytest.mark.attack("the service killed -9 at a moment of a run or a push", "OPC UA"),
        pytest.mark.timeout(6 * 3600),
    ],
)


@pytest.mark.parametrize(("kills", "seed"), [FEW, MANY])
def test_killed_at_any_moment_nothing_is_lost_and_nothing_is_written(tmp_path: Path, kills: int, seed: int) -> None:
    chance, seen = random.Random(seed), Seen()

    async def main() -> None:
        async with shop(tmp_path, LoopClock(SPEED)) as at:
            store = store_of(at.site, at.path)
            for number in range(1, kills + 1):
                await one_life(at, store, seen, chance)
                print(f"killed {number} times, start {seen.starts_s[-1]:.2f} s, {seen.states[-1:]}", flush=True)
            kept(store, seen)
            async with living(at) as life:
                found = (await life.ask("/search?most=1000"))["runs"]
            assert {one["run_id"] for one in found} == set(seen.stages)

    asyncio.run(main())
    starts = sorted(seen.starts_s)
    print(seen.states, f"starts {starts}, {seen.held} found a push open, {seen.pushes} pushes")
    assert starts[-1] < HANGS_S, "recovery needed is said by the first picture, and a start does not hang"
    assert kills < 20 or seen.held > kills // 20, "some kills met a push"
