"""The audit log and the index: checking against hashing alone, asking a million figures, growth with the records."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.report import Report, main, slope, spent
from drivers.clock import LoopClock
from gateway import audit
from gateway.audit import AUDIT, audit_files
from gateway.index.database import RunIndex
from gateway.index.rows import IndexedFigure, IndexedRun


def log_of(root: Path, count: int) -> bytes:
    """An audit log of ``count`` chained records, written at once; its bytes."""
    (root / AUDIT).mkdir(parents=True)
    head, lines = audit.ChainHead(), []
    happening = audit.AuditEvent("push-start", "ann", "operator", "SN-1", 7, "ab" * 32, "cd" * 32, "", {"axis": "C1"})
    for number in range(1, count + 1):
        entry = audit.AuditEntry(number, "2026-11-21T10:00:00.000+00:00", 1.5, 77, "0.1.0", happening, head.hash)
        line, head = audit.encode_line(entry)
        lines.append(line)
    (root / AUDIT / "audit-000001.jsonl").write_bytes(b"".join(lines))
    (root / AUDIT / "head").write_text(f"{head}\n")
    return audit_files(root / AUDIT)[0].read_bytes()


def log(report: Report, folder: Path) -> None:
    """Checking the chain, and one durable record."""
    sizes = [100.0, 200.0] if report.smoke else [5_000.0, 20_000.0]
    times = []
    for size in sizes:
        root = folder / f"log-{size:.0f}"
        data = log_of(root, int(size))
        times.append(spent(lambda root=root: _sound(root)))
    floor = spent(lambda: [hashlib.sha256(line).hexdigest() for line in data.split(b"\n")])
    report.at_most(f"audit: {sizes[-1]:.0f} records checked / hashing the same lines", times[-1] / floor, 12.0)
    report.at_most(f"growth: slope of the check up to {sizes[-1]:.0f} records", slope(sizes, times), 1.15)
    report.say(
        "audit: one record, durable, wall time",
        1e3 * asyncio.run(recorded(folder / "short", report.pick(200, 5))),
        "ms",
    )


async def recorded(root: Path, count: int) -> float:
    """Seconds for one durable record."""
    clock = LoopClock()
    begun = perf_counter()
    for number in range(count):
        audit.record(root, "approve", clock=clock, transaction=number)
    return (perf_counter() - begun) / count


def _sound(root: Path) -> None:
    if not audit.check_log(root).sound:
        raise SystemExit("the benchmark's own log is not sound")


def index(report: Report, folder: Path) -> None:
    """A fleet's figures: 500 machines over ten years, the newest of each."""
    sizes = [400.0, 800.0] if report.smoke else [100_000.0, 1_000_000.0]
    machines = report.pick(500, 20)
    times, pages = [], []
    for size in sizes:
        made = RunIndex(folder / f"index-{size:.0f}")
        (folder / f"index-{size:.0f}").mkdir()
        made.open()
        runs = int(size) // 10
        for first in range(0, runs, 2000):
            made.put(_run(made.gateway, number, machines) for number in range(first, min(first + 2000, runs)))
        found = made.newest("E", subject="X1", phases=("before", "after"))
        if len(found) != machines or any(int(row["run_id"]) < runs - machines for row in found):
            raise SystemExit("the newest figure of each machine is not the newest")
        times.append(spent(lambda made=made: made.newest("E", subject="X1", phases=("before", "after"))))
        pages.append(spent(lambda made=made: made.trend("E", serial="SN-7", subject="X1", most=100)))
    report.at_most(f"index: newest of {machines} machines among {sizes[-1]:.0f} figures", times[-1], 0.5, "s")
    report.at_most(f"index: one page of a trend among {sizes[-1]:.0f} figures", pages[-1], 0.05, "s")
    report.say("growth: slope of the newest figures", slope(sizes, times))


def _run(gateway: str, number: int, machines: int) -> tuple[IndexedRun, list[IndexedFigure]]:
    serial, when = f"SN-{number % machines}", f"2016-01-01T00:00:00.{number:07d}+00:00"
    run = IndexedRun(gateway, f"{number:08d}", "hall-3", serial, when, "pushed", "1.0", "", str(number))
    subjects = [
        ("X1", "E"),
        ("X1", "R"),
        ("X1", "B"),
        ("X1", "A"),
        ("X1", "M"),
        ("C1", "E"),
        ("C1", "R"),
        ("C1", "B"),
        ("C1", "A"),
    ]
    figures = [IndexedFigure(gateway, run.run_id, axis, "before", name, 1.0, 0.1, "um") for axis, name in subjects]
    return run, [*figures, IndexedFigure(gateway, run.run_id, "flank", "before", "rms", 1.0, 0.1, "um")]


def measure(report: Report) -> None:
    """All figures of this file."""
    with tempfile.TemporaryDirectory() as name:
        log(report, Path(name))
        index(report, Path(name))


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
