"""One way to measure, print, judge and keep the figures of a benchmark.

A benchmark is a function of a `Report`. Speed is a ratio of processor times in one process, against a floor measured
in the same run, so that neither the computer nor what else it does matters much. A figure beyond its limit ends the
run with 1.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from math import log
from pathlib import Path
from time import process_time
from typing import Literal

REPEATS = 3
SHORTEST_S = 0.02  # a piece of work is repeated until its processor time can be told from the clock's own steps


@dataclass(frozen=True)
class Figure:
    """One measured figure; without a limit it is for information."""

    text: str
    value: float
    unit: str = ""
    sense: Literal["", "<=", ">="] = ""
    limit: float = float("nan")

    @property
    def met(self) -> bool:
        """Whether the figure keeps its limit."""
        if not self.sense:
            return True
        return self.value <= self.limit if self.sense == "<=" else self.value >= self.limit

    @property
    def asked(self) -> str:
        """The limit in words; empty without one."""
        return f"{self.sense} {self.limit:g}{' ' if self.unit else ''}{self.unit}" if self.sense else ""

    def line(self, *, judged: bool) -> str:
        """One line of the terminal."""
        missed = "" if self.met or not judged else "  MISSED"
        return f"{self.text:<84} {self.value:10.4g} {self.unit:<6} {self.asked}{missed}".rstrip()


@dataclass
class Report:
    """What a benchmark found. ``smoke``: small sizes, where a ratio says nothing and no limit is judged."""

    smoke: bool = False
    figures: list[Figure] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def say(self, text: str, value: float, unit: str = "") -> None:
        """A figure without a limit."""
        self._keep(Figure(text, float(value), unit))

    def at_most(self, text: str, value: float, limit: float, unit: str = "") -> None:
        """A figure that must not exceed its limit."""
        self._keep(Figure(text, float(value), unit, "<=", limit))

    def at_least(self, text: str, value: float, limit: float, unit: str = "") -> None:
        """A figure that must reach its limit."""
        self._keep(Figure(text, float(value), unit, ">=", limit))

    def leave_out(self, text: str, why: str) -> None:
        """What could not be measured here."""
        self.left_out.append(f"{text}: not measured ({why})")
        _print(self.left_out[-1])

    def pick(self, full: int, small: int) -> int:
        """A size: ``small`` in the smoke form."""
        return small if self.smoke else full

    @property
    def missed(self) -> list[Figure]:
        """The figures beyond their limits; none in the smoke form."""
        return [] if self.smoke else [figure for figure in self.figures if not figure.met]

    def _keep(self, figure: Figure) -> None:
        self.figures.append(figure)
        _print(figure.line(judged=not self.smoke))


def spent(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """The least processor time of one call among some, s; short calls are repeated until they can be timed."""
    calls, first = 1, _used(work, 1)
    if first < SHORTEST_S:
        calls = max(1, int(SHORTEST_S / max(first, 1e-6)))
    return min(_used(work, calls) for _ in range(repeats)) / calls


@dataclass(frozen=True)
class Child:
    """What a command of ours took: processor time (s), the most memory it held (MB), its exit code."""

    cpu_s: float
    memory_mb: float
    code: int


# What the system keeps of a process' memory begins with that of its parent: the command reads its own at its end.
COMMAND = """
import atexit, sys

def told():
    with open(sys.argv.pop(), "w") as file:
        lines = open("/proc/self/status").read().splitlines()
        file.write(next(line.split()[1] for line in lines if line.startswith("VmHWM")))

atexit.register(told)
place = sys.argv.pop(1)
from gateway.cli import main
sys.argv[0] = "trueflank"
try:
    code = main()
finally:
    sys.argv.append(place)
sys.exit(code)
"""


def child(words: list[str], folder: Path | None = None) -> Child:
    """Run ``trueflank`` with these words in a process of its own, its output dropped. Linux only."""
    null = subprocess.DEVNULL
    with tempfile.NamedTemporaryFile("r") as memory:
        command = [sys.executable, "-c", COMMAND, memory.name, *words]
        process = subprocess.Popen(command, stdin=null, stdout=null, stderr=null, cwd=folder)  # noqa: S603 - ourselves
        _pid, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        held_kb = float(memory.read() or "nan")
    return Child(used.ru_utime + used.ru_stime, held_kb / 1024.0, process.returncode)


def slope(sizes: list[float], times: list[float]) -> float:
    """The slope of log time over log size by its last two points: 1 is linear, 2 quadratic."""
    return log(times[-1] / times[-2]) / log(sizes[-1] / sizes[-2])


def main(measure: Callable[[Report], None], doc: str | None) -> int:
    """Run one benchmark from the command line; 1 where a limit is missed."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--smoke", action="store_true", help="small sizes, no limit judged")
    parser.add_argument("--json", type=Path, help="keep the figures in this file")
    options = parser.parse_args()
    report = Report(options.smoke)
    measure(report)
    if options.json:
        kept = {"figures": [asdict(figure) for figure in report.figures], "left_out": report.left_out}
        options.json.write_text(json.dumps(kept), encoding="utf-8")
    return int(bool(report.missed))


def _used(work: Callable[[], object], calls: int) -> float:
    before = process_time()
    for _ in range(calls):
        work()
    return process_time() - before


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
