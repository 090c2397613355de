"""A log to try things on: written by the same calls as the product's, with a clock that needs no loop."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from drivers.types.uptime import Uptime
from gateway.audit.chain import AUDIT, HEAD, AuditEntry, AuditEvent, ChainHead, audit_files, encode_line, file_name


@dataclass
class Moments:
    """A clock that goes on by one second at every look."""

    seconds: float = 0.0

    def now(self) -> float:
        self.seconds += 1.0
        return self.seconds

    def utc(self) -> datetime:
        return datetime(2026, 11, 21, 10, tzinfo=UTC) + timedelta(seconds=self.seconds)

    def uptime(self) -> Uptime:
        return Uptime("start", self.seconds)

    async def sleep(self, seconds: float) -> None:
        self.seconds += seconds

    def deadline(self, timeout_s: float, where: str) -> AbstractAsyncContextManager[None]:
        raise AssertionError("nothing waits here")


def bulk(root: Path, count: int, per_file: int) -> ChainHead:
    """A long log as `append` would leave it, without an fsync for each record."""
    folder = root / AUDIT
    folder.mkdir(parents=True)
    head, lines = ChainHead(), []
    for number in range(1, count + 1):
        happening = AuditEvent(
            "push-start", "ann", "operator", "SN-1", number, "ab" * 32, "cd" * 32, "", {"axis": "C1"}
        )
        entry = AuditEntry(number, "2026-11-21T10:00:00.000+00:00", float(number), 77, "0.1.0", happening, head.hash)
        line, head = encode_line(entry)
        lines.append(line)
        if number % per_file == 0 or number == count:
            (folder / file_name((number - 1) // per_file + 1)).write_bytes(b"".join(lines))
            lines = []
    (folder / HEAD).write_text(f"{head}\n")
    return head


def log_files(root: Path) -> list[Path]:
    """Every file that counts."""
    return [*audit_files(root / AUDIT), root / AUDIT / HEAD]
