"""What each test costs in processor time, its ended child processes included: `make slowest`.

Processor time, not wall time: what else the computer does, and how long a test waits, is no cost of the test.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import PurePosixPath

import pytest

KEY = "processor_s"
TOP = 10


def now_s() -> float:
    """Processor time of this process and of every child that it has waited for, in seconds."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def folder_of(nodeid: str) -> str:
    """The folder of a test, three names deep at most: tests/unit/cli."""
    return "/".join(PurePosixPath(nodeid.split("::", 1)[0]).parent.parts[:3])


def table(spent: dict[str, float], started: Iterable[float] = ()) -> list[str]:
    """Lines for people: the slowest tests, the sums by file and by folder, and what it takes before the first test."""
    folders: dict[str, list[float]] = defaultdict(list)
    files: dict[str, list[float]] = defaultdict(list)
    for nodeid, seconds in spent.items():
        folders[folder_of(nodeid)].append(seconds)
        files[nodeid.split("::", 1)[0]].append(seconds)
    slowest = sorted(spent.items(), key=lambda item: -item[1])[:TOP]
    lines = [f"processor time of {len(spent)} tests: {sum(spent.values()):.1f} s"]
    lines += [f"until the first test: {seconds:.1f} s in a process" for seconds in started]
    for title, sums in (("file", files), ("folder", folders)):
        ordered = sorted(sums.items(), key=lambda item: -sum(item[1]))[: 3 * TOP]
        lines += ["", f"by {title}", *(f"{sum(each):8.1f} s {len(each):5d}  {name}" for name, each in ordered)]
    lines += ["", f"the {len(slowest)} slowest tests"]
    return lines + [f"{seconds:8.1f} s  {name}" for name, seconds in slowest]


class Spent:
    """A pytest plugin that counts; where tests run in workers each tells its own and the first process adds."""

    def __init__(self, config: pytest.Config) -> None:
        self._worker = hasattr(config, "workerinput")
        self._spent: dict[str, float] = defaultdict(float)
        self._started: list[float] = []
        self._first, self._begun = True, 0.0

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Count one test with its fixtures; those of a module or session go to the test that made them."""
        started = now_s()
        if self._first:
            self._first = False
            item.user_properties.append((f"{KEY}_started", started))
        self._begun = started
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Write into each report of a test what has been spent since the one before."""
        report = yield
        ended = now_s()
        report.user_properties = [*report.user_properties, (KEY, ended - self._begun)]
        self._begun = ended
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add up what the reports say."""
        if self._worker:
            return
        said = dict(report.user_properties)
        self._spent[report.nodeid] += float(said.get(KEY, 0.0))
        if report.when == "setup" and f"{KEY}_started" in said:
            self._started.append(float(said[f"{KEY}_started"]))

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the table."""
        for line in table(self._spent, self._started):
            terminalreporter.write_line(line)
