"""The service under load: crowds, half-open connections and streams beside a 50 kHz capture; run by `make services`."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from benchmarks.streams import BRIDGE
from drivers.bridge.device import BridgeInstrument
from drivers.clock import LoopClock
from gateway.broker.state_folder import token_path
from gateway.daemon.site_service import SiteService
from gateway.live import onlooker
from gateway.say import Say
from tests.unit.web.test_daemon import SECURE, SITE, certificate, served

pytestmark = [
    pytest.mark.services,
    pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the kernel does not say who waited"),
]
RATE, FRAME = 50_000, 500
MOST_LAG_S, SOON_S = 0.1, 0.2
CLIENTS = Path(__file__).with_name("clients.py")
# A stream in real time: the bridge of the benchmarks pours as fast as it is read.
PACED = BRIDGE.replace("import json,", "import time, json,").replace(
    'peer.sendall(b"".join(out))',
    'peer.sendall(b"".join(out))\n                        begun = begun if number else time.monotonic()\n'
    "                        time.sleep(max(0.0, begun + (number + 8) * samples / rate - time.monotonic()))",
)


@asynccontextmanager
async def bridge(seconds: int) -> AsyncIterator[int]:
    """A laser of 50 kHz in a process of its own; its port."""
    words = [sys.executable, "-c", PACED, str(RATE), str(FRAME), str(seconds * RATE // FRAME), "1"]
    child = await asyncio.create_subprocess_exec(*words, stdout=subprocess.PIPE)
    assert child.stdout is not None
    try:
        yield int(await child.stdout.readline())
    finally:
        child.kill()
        await child.wait()


async def clients(url: httpx.URL, token: str, *numbers: int) -> dict[str, Any]:
    tls = ["tls"] if url.scheme == "https" else []
    words = [sys.executable, str(CLIENTS), str(url.port), token, "hall-3", *map(str, numbers), *tls]
    child = await asyncio.create_subprocess_exec(*words, stdout=subprocess.PIPE)
    out, _err = await child.communicate()
    found: dict[str, Any] = json.loads(out)
    return found


def waited() -> float:
    """How long this process's threads were ready and got no processor so far, s: what other programs cost it.

    All of them: the loop also waits for whichever of them holds the interpreter and was put aside.
    """
    parts = (path.read_text(encoding="ascii").split() for path in Path("/proc/self/task").glob("*/schedstat"))
    return sum(int(part[1]) for part in parts) / 1e9


async def lag(told: list[float], idle: list[tuple[float, float]]) -> None:
    """How much later than asked for the loop comes back, s, less what other programs cost it.

    ``idle`` gets when this was looked at, and how long the process had waited for a processor by then.
    """
    loop = asyncio.get_running_loop()
    while True:
        before, other = loop.time(), waited()
        idle.append((before, other))
        await LoopClock().sleep(0.005)
        told.append(loop.time() - before - 0.005 - (waited() - other))


def own_s(probe: tuple[float, float, float], idle: list[tuple[float, float]]) -> float:
    """How long a question for health took, s, less what other programs cost those who asked and answered meanwhile."""
    took, begun, waited_there = probe
    before = max((one for at, one in idle if at <= begun), default=idle[0][1])
    after = min((one for at, one in idle if at >= begun + took), default=idle[-1][1])
    return took - waited_there - (after - before)


def captured(
    folder: Path, monkeypatch: pytest.MonkeyPatch, numbers: tuple[int, int, int], seconds: int, *, secure: bool = False
) -> Any:
    """What clients met while a capture went on, and what it got: (clients, samples, lost, latest lags)."""
    met: dict[str, Any] = {"samples": 0, "lost": 0, "lag": [], "idle": []}
    places: list[SiteService] = []
    whole = SiteService.__init__

    def noted(self: SiteService, *given: Any) -> None:
        whole(self, *given)
        places.append(self)

    monkeypatch.setattr(SiteService, "__init__", noted)

    async def body(client: httpx.AsyncClient, _stop: asyncio.Event) -> None:
        done = asyncio.Event()

        async def work(_say: Say) -> None:
            async with bridge(seconds) as port:
                device = BridgeInstrument("laser", f"tcp://127.0.0.1:{port}", {}, LoopClock())
                await device.open(30.0)
                async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
                    async for block in stream:
                        met["samples"] += len(block)
                        met["lost"] += block.lost
                        # The moment of its arrival goes with it, for whoever measures how old it is at the page.
                        moment = np.full((len(block), 1), LoopClock().utc().timestamp())
                        dated = type(block)(
                            (*block.channels, "moment"), block.time_s, np.hstack((block.values, moment)), block.valid
                        )
                        onlooker().samples("laser", dated)
                        if met["samples"] >= seconds * RATE:
                            break
                await device.close()
            done.set()

        token = token_path(folder).read_text(encoding="ascii").strip()
        lags = asyncio.create_task(lag(met["lag"], met["idle"]))
        crowd = asyncio.create_task(clients(client.base_url, token, *numbers, seconds - 2))
        probe = asyncio.create_task(clients(client.base_url, token, 0, 0, 0, seconds - 2))
        places[0].begin(work, kind="run", who="anna")
        met["clients"] = await crowd
        probed = await probe
        met["probes"] = probed["probes"]
        await done.wait()
        lags.cancel()
        await asyncio.gather(lags, return_exceptions=True)

    if secure:
        served(folder, body, site=SECURE, trust=certificate(folder))
    else:
        served(folder, body)
    met["health_s"] = sorted(own_s(tuple(one), met["idle"]) for one in met["probes"])
    return met


def told(met: dict[str, Any]) -> str:
    """The figures of a round in one line, also printed."""
    taken = [one[0] for one in met["probes"]]
    line = f"health {len(taken)} times, by the clock at most {max(taken):.2f} s, own {met['health_s'][-1]:.2f} s; "
    line += f"lag at most {max(met['lag']):.3f} s; {met['clients']['crowd']}"
    print(line)
    return line


def test_a_crowd_and_half_open_connections_hold_up_neither_health_nor_capture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    met = captured(tmp_path, monkeypatch, (1000, 2000, 0), 12)
    said = told(met)
    found = met["clients"]
    assert (met["samples"], met["lost"]) == (12 * RATE, 0)
    assert found["health"] == [200]
    # The slowest answer, less the turns that other programs had on the processors meanwhile.
    assert met["health_s"][-1] < 2.0, said
    assert sum(found["crowd"].values()) == 2000
    assert set(found["crowd"]) <= {"200", "429", "503"}


def test_over_tls_a_crowd_holds_up_neither_health_nor_capture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    met = captured(tmp_path, monkeypatch, (1000, 2000, 0), 12, secure=True)
    said = told(met)
    found = met["clients"]
    assert (met["samples"], met["lost"]) == (12 * RATE, 0)
    assert found["health"] == [200]
    assert met["health_s"][-1] < 4.0, f"each handshake takes its 1 to 2 ms: {said}"
    assert sum(found["crowd"].values()) == 2000
    assert set(found["crowd"]) <= {"200", "429", "503"}


def test_eight_pages_on_a_50_khz_capture_lose_no_sample_and_hold_up_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    met = captured(tmp_path, monkeypatch, (0, 0, 8), 12)
    found = met["clients"]
    told(met)
    assert (met["samples"], met["lost"]) == (12 * RATE, 0)
    assert len(found["pages"]) == 8
    for page in found["pages"]:
        assert page["lost"] == 0
        assert page["counted"] > 8 * RATE
    # A loop that is held up is late again and again. Twice may be the kernel's doing.
    assert len([one for one in met["lag"] if one > MOST_LAG_S]) <= 2
    assert len(met["lag"]) > 100
    assert found["age_s"][0] < SOON_S, "half of the readings come in time, on a busy computer too"


assert SITE.site.name == "hall-3"
