"""Speed of the audit log, measured in one run: `python benchmarks/audit.py`."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from drivers.clock import LoopClock
from gateway import audit
from gateway.audit.chain import AUDIT, files

COUNT = 20_000
APPENDED = 200
ASKED_PER_S = 50_000
SLOW = 3.0


def say(text: str, value: float, limit: str = "") -> None:
    """One line of the report."""
    sys.stdout.write(f"{text:<66} {value:10.4g}  {limit}\n")
    sys.stdout.flush()


def written(root: Path) -> None:
    """A log of many records: a few appended as the product does, then copies chained in memory."""
    (root / AUDIT).mkdir(parents=True)
    head, lines = audit.ChainHead(), []
    happening = audit.Happening("push-start", "ann", "operator", "SN-1", 7, "ab" * 32, "cd" * 32, "", {"axis": "C1"})
    for number in range(1, COUNT + 1):
        entry = audit.AuditEntry(number, "2026-11-21T10:00:00.000+00:00", 1.5, 77, "0.1.0", happening, head.hash)
        line, head = audit.line_of(entry)
        lines.append(line)
    (root / AUDIT / "audit-000001.jsonl").write_bytes(b"".join(lines))
    (root / AUDIT / "head").write_text(f"{head}\n")


async def appended(root: Path) -> float:
    """Seconds for one record, durable."""
    clock = LoopClock()
    start = perf_counter()
    for number in range(APPENDED):
        audit.record(root, "approve", clock=clock, transaction=number)
    return (perf_counter() - start) / APPENDED


def main() -> int:
    """Print the figures; fails only at three times the time asked."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        written(root / "long")
        start = perf_counter()
        health = audit.check(root / "long")
        check_s = perf_counter() - start
        data = files(root / "long" / AUDIT)[0].read_bytes()
        start = perf_counter()
        for line in data.split(b"\n"):
            hashlib.sha256(line).hexdigest()
        floor_s = perf_counter() - start
        say("verify, records per second", COUNT / check_s, f">= {ASKED_PER_S}")
        say("verify / hashing the same lines and nothing else", check_s / floor_s)
        say("one record, durable, ms", 1e3 * asyncio.run(appended(root / "short")), "<= 20")
    return int(not health.sound or check_s > SLOW * COUNT / ASKED_PER_S)


if __name__ == "__main__":
    sys.exit(main())
