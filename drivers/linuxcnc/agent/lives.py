"""Which life of the kernel this is: its process and when it began, from /proc."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

PROC = Path("/proc")
TASK = "milltask"
ENDED = "ZX"  # a process that has ended is listed until its parent asks for it


@dataclass(frozen=True)
class Life:
    """A kernel that runs: ``name`` is the same as long as it lives, ``began_s`` is wall-clock time (s, to 0.01 s).

    That time moves when somebody sets the host's clock, so it is no part of what makes two lives the same.
    """

    name: str
    began_s: float = field(compare=False)


def running() -> Life | None:
    """The kernel's task process now; None where there is none."""
    return next(filter(None, map(_life, PROC.glob("[0-9]*"))), None)


def lives(life: Life | None) -> bool:
    """Whether this life goes on; where there was none, whether there still is none."""
    if life is None:
        return running() is None
    return _life(PROC / life.name.partition("-")[0]) == life


def _life(folder: Path) -> Life | None:
    try:
        words = (folder / "stat").read_text().rpartition(")")
    except OSError:  # it ended while we looked
        return None
    rest = words[2].split()
    if words[0].partition("(")[2] != TASK or rest[0] in ENDED:
        return None
    ticks = int(rest[19])
    return Life(f"{folder.name}-{ticks}", _boot_s() + ticks / os.sysconf("SC_CLK_TCK"))


def _boot_s() -> float:
    found = [line.split()[1] for line in (PROC / "stat").read_text().splitlines() if line.startswith("btime")]
    return float(found[0])
