"""Which life of the kernel this is: its process and when it began, from /proc."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
TASK = "milltask"
ENDED = "ZX"  # a process that has ended is listed until its parent asks for it


@dataclass(frozen=True)
class Life:
    """A kernel that runs: ``name`` is the same as long as it lives, ``began_s`` is wall-clock time (s, to 0.01 s)."""

    name: str
    began_s: float


def running() -> Life | None:
    """The kernel's task process now; None where there is none."""
    for folder in PROC.glob("[0-9]*"):
        try:
            words = (folder / "stat").read_text().rpartition(")")
            rest = words[2].split()
            if words[0].partition("(")[2] == TASK and rest[0] not in ENDED:
                ticks = int(rest[19])
                return Life(f"{folder.name}-{ticks}", _boot_s() + ticks / os.sysconf("SC_CLK_TCK"))
        except OSError:  # it ended while we looked
            continue
    return None


def _boot_s() -> float:
    found = [line.split()[1] for line in (PROC / "stat").read_text().splitlines() if line.startswith("btime")]
    return float(found[0])
