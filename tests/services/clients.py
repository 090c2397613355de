"""Clients of a service in a process of their own: half-open connections, streams, crowds; prints what they met as JSON.

`python clients.py PORT TOKEN SITE HALF CROWD STREAMS SECONDS [tls]`; nothing of ours is imported: time is the wall's.
"""
# ruff: noqa: TID251

from __future__ import annotations

import asyncio
import json
import ssl
import sys
import time
from contextlib import suppress
from pathlib import Path

PORT, TOKEN, SITE = int(sys.argv[1]), sys.argv[2], sys.argv[3]
HALF, CROWD, STREAMS, SECONDS = (int(word) for word in sys.argv[4:8])
TLS = ssl.create_default_context() if sys.argv[8:] == ["tls"] else None
if TLS is not None:
    TLS.check_hostname, TLS.verify_mode = False, ssl.CERT_NONE
HEAD = f"Host: 127.0.0.1:{PORT}\r\nAuthorization: Bearer {TOKEN}\r\nConnection: close\r\n\r\n"


async def ask(path: str, seconds: float = 60.0) -> tuple[int, float]:
    """Status (0 where the connection broke) and how long it took, s."""
    begun = time.perf_counter()
    status = 0
    with suppress(OSError, ValueError, IndexError):
        reader, writer = await asyncio.open_connection("127.0.0.1", PORT, ssl=TLS)
        writer.write(f"GET {path} HTTP/1.1\r\n{HEAD}".encode())
        line = await reader.readline()
        status = int(line.split()[1])
        await reader.read()
        writer.close()
    return status, time.perf_counter() - begun


async def half_open() -> None:
    """Begins a head (over TLS: a handshake) and never ends it."""
    with suppress(OSError):
        reader, writer = await asyncio.open_connection("127.0.0.1", PORT)
        writer.write(b"\x16\x03\x01" if TLS else b"GET /healthz HT")
        await reader.read()
        writer.close()


async def listen(until: float, told: dict[str, float]) -> None:
    """A page's stream: samples counted, lost frames, and how old a reading is at its arrival, s."""
    reader, writer = await asyncio.open_connection("127.0.0.1", PORT, limit=1 << 24)
    writer.write(f"GET /api/v1/sites/{SITE}/stream HTTP/1.1\r\n{HEAD}".encode())
    kind = ""
    while time.time() < until:
        line = (await reader.readline()).decode()
        if not line:
            break
        if line.startswith("event: "):
            kind = line[7:].strip()
        elif line.startswith("data: "):
            data = json.loads(line[6:])
            if kind == "reading":
                told["samples"] = max(told["samples"], data["sequence"])
                told["counted"] += data["count"]
                told["ages"].append(time.time() - data["last"][1])
            told["lost"] += data["frames"] if kind == "lost" else 0
    writer.close()


def waited() -> float:
    """How long this process was ready and got no processor so far, s."""
    return int(Path("/proc/self/schedstat").read_text(encoding="ascii").split()[1]) / 1e9


async def main() -> None:
    """Everything at once."""
    until = time.time() + SECONDS
    pages = [{"samples": 0, "counted": 0, "lost": 0, "ages": []} for _page in range(STREAMS)]
    streams = [asyncio.create_task(listen(until, told)) for told in pages]
    halves = [asyncio.create_task(half_open()) for _one in range(HALF)]
    await asyncio.sleep(1.0)
    crowd = [asyncio.create_task(ask(f"/api/v1/sites/{SITE}/jobs")) for _one in range(CROWD)]
    probes = []
    while time.time() < until:
        begun, idle = time.monotonic(), waited()
        status, took = await ask("/healthz")
        probes.append((status, took, begun, waited() - idle))
        await asyncio.sleep(0.1)
    statuses: dict[int, int] = {}
    for one in crowd:
        status, _took = await one
        statuses[status] = statuses.get(status, 0) + 1
    for one in halves:
        one.cancel()
    await asyncio.gather(*halves, return_exceptions=True)
    await asyncio.gather(*streams, return_exceptions=True)
    ages = sorted(age for told in pages for age in told.pop("ages"))
    print(
        json.dumps(
            {
                "health_s": [probe[1] for probe in probes],
                "health": sorted({probe[0] for probe in probes}),
                "probes": [probe[1:] for probe in probes],
                "crowd": statuses,
                "pages": pages,
                "age_s": [ages[len(ages) // 2], ages[-1]] if ages else [],
            }
        )
    )


asyncio.run(main())
