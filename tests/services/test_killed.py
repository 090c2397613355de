"""The service killed -9 at random moments of runs and pushes beside a machine that goes on; run by `make services`.

What must hold after each: every record that was there can be read, nothing is written by the new start, and its page
says soon that recovery is needed. `KILLS=100` asks for more.
"""

from __future__ import annotations

import asyncio
import os
import random
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
from gateway.broker.token import token_path
from gateway.store import RunFolder, Store
from gateway.workflow.bench import store_of
from tests.cell.stops import INTERRUPTED, Shop, shop, table_of

KILLS = int(os.environ.get("KILLS", "10"))
pytestmark = [
    pytest.mark.services,
    pytest.mark.timeout(600 + 60 * KILLS),
    pytest.mark.skipif(sys.platform == "win32", reason="kill -9, and /proc"),
]
SPEED, SOON_S, WAIT_S = 120.0, 3.0, 90.0


@dataclass
class Life:
    """One service process and its page."""

    child: asyncio.subprocess.Process
    client: httpx.AsyncClient
    at: str
    first: dict[str, Any]
    took_s: float
    busy_s: float

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


def busy_s(pid: int) -> float:
    """How long a process has kept processors busy since it began, s: what other programs do stretches it little."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


@asynccontextmanager
async def living(at: Shop) -> AsyncIterator[Life]:
    """A service begun, its first picture, and how long after the start that was; killed -9 at the end."""
    loop, root = asyncio.get_running_loop(), store_of(at.site, at.path).root
    begun = loop.time()
    words = ["-m", "gateway.cli", "serve", str(at.path), "--port", "0"]
    log = (at.path.parent / "serve.log").open("ab")
    child = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE, stderr=log)
    assert child.stdout is not None
    try:
        line = (await child.stdout.readline()).decode()
        url = next(word for word in line.split() if word.startswith("http"))
        head = {"Authorization": f"Bearer {token_path(root).read_text(encoding='ascii').strip()}"}
        async with httpx.AsyncClient(base_url=url, headers=head, trust_env=False, timeout=300.0) as client:
            where = f"/api/v1/sites/{at.site.site.name}"
            first = (await client.get(f"{where}/status")).json()
            yield Life(child, client, where, first, loop.time() - begun, busy_s(child.pid))
    finally:
        with suppress(ProcessLookupError):
            child.kill()
        await child.wait()
        log.close()


@dataclass
class Seen:
    """What was kept before the kill, for comparing."""

    stages: dict[str, set[str]] = field(default_factory=dict)
    audit: int = 0
    starts_s: list[float] = field(default_factory=list)
    busy_s: list[float] = field(default_factory=list)
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
    records = list(audit.entries(store.root))
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
        seen.busy_s.append(life.busy_s)
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


def test_killed_at_any_moment_nothing_is_lost_and_nothing_is_written(tmp_path: Path) -> None:
    chance, seen = random.Random(20261123), Seen()

    async def main() -> None:
        async with shop(tmp_path, LoopClock(SPEED)) as at:
            store = store_of(at.site, at.path)
            for _life in range(KILLS):
                await one_life(at, store, seen, chance)
            kept(store, seen)
            async with living(at) as life:
                found = (await life.ask("/search?most=1000"))["runs"]
            assert {one["run_id"] for one in found} == set(seen.stages)

    asyncio.run(main())
    print(seen.states, "starts", sorted(seen.starts_s), "busy", sorted(seen.busy_s), seen.held, seen.pushes)
    # What else this machine does makes a start longer, the simulated machine beside it among that: so what the start
    # itself keeps busy is judged. The first one may have sources to compile.
    assert sorted(seen.busy_s)[len(seen.busy_s) // 2] < SOON_S
    assert KILLS < 20 or seen.held > KILLS // 20, "some kills met a push"
