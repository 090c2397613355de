"""Time that does not go as usual in whole runs: the end of summer time, a laptop that was suspended."""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, VirtualTimeLoop
from drivers.errors import TrueflankError
from gateway.domain.captures import Capture
from gateway.store import RunFolder
from gateway.workflow.run import stages
from simulators.cell import Cell
from tests.cell import bench
from tests.cell.bench import Judged, main_job, short
from tests.sizes import long

AT_STOP = 5
SUSPENDED_S = 5 * 3600.0


def summer_ends() -> datetime:
    """The last Sunday of next year's October, 1:00 UTC: certificates made today are valid then."""
    last = datetime(datetime.now(UTC).year + 1, 10, 31, 1, tzinfo=UTC)
    return last - timedelta(days=(last.weekday() + 1) % 7)


class Jumping(LoopClock):
    """A clock whose calendar goes ahead of its count, as after a sleep that the count does not count."""

    ahead_s = 0.0

    def utc(self) -> datetime:
        """The calendar."""
        return super().utc() + timedelta(seconds=self.ahead_s)


@pytest.fixture
def in_berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The computer's own time has summer time."""
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def right(judged: Judged, axis: str) -> None:
    """The figures are the machine's, by its truth."""
    measured, truth = judged.outcome.data["axes"][axis]["before"], judged.before[axis]
    assert measured["M"] == pytest.approx(truth["M"], rel=0.3)


def captured(judged: Judged, axis: str) -> Capture:
    """What was stored of the measurement."""
    folder = RunFolder(Path(judged.outcome.run_folder))
    return folder.get(stages.capture(axis, "before"), Capture)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="the zone is the system's")
@pytest.mark.parametrize("axis", [long("X1")])
def test_summer_time_ends_in_mid_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_berlin: None, axis: str
) -> None:
    """At 1:00 UTC the local clock shows 2:00 a second time: no record goes back, none is an hour long."""
    ends = summer_ends()
    before, after = (ends + timedelta(hours=hours) for hours in (-1, 1))
    shown = [time.localtime(one.timestamp()).tm_hour for one in (before, ends, after)]
    assert shown == [2, 2, 3], "the computer's own clock is set back then"
    began = ends - timedelta(minutes=12)
    monkeypatch.setattr(bench, "LoopClock", functools.partial(LoopClock, started_utc=began))
    judged = main_job(tmp_path, apply=False, edit=short((axis,)))
    right(judged, axis)
    found = captured(judged, axis)
    since, until = datetime.fromisoformat(found.started_utc), datetime.fromisoformat(found.ended_utc)
    assert since.utcoffset() == until.utcoffset() == timedelta(0)
    assert began <= since < until
    assert until - since < timedelta(minutes=50)


def suspended(monkeypatch: pytest.MonkeyPatch, *, counted: bool) -> Any:
    """At a stop the computer sleeps for hours: its calendar goes on, and its count where it counts sleep."""
    clocks: list[Jumping] = []

    def made(*args: Any, **more: Any) -> Jumping:
        clocks.append(Jumping(*args, **more))
        return clocks[-1]

    monkeypatch.setattr(bench, "LoopClock", made)
    done: list[bool] = []

    def heard(_cell: Cell, code: str, fields: dict[str, object]) -> None:
        if code != "P-STOP" or fields["done"] != AT_STOP or done:
            return
        done.append(True)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        if counted:
            loop.jump(SUSPENDED_S)
        for clock in clocks:
            clock.ahead_s += SUSPENDED_S

    return heard, done


@pytest.mark.parametrize("counted", [long(False), long(True)], ids=["calendar alone", "calendar and count"])
def test_a_suspended_laptop_ends_with_its_reason_or_the_right_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: bool
) -> None:
    heard, done = suspended(monkeypatch, counted=counted)
    if counted:
        with pytest.raises(TrueflankError) as caught:
            main_job(tmp_path, apply=False, edit=short(("X1",)), heard=heard)
        print("ENDS", caught.value.code)
        assert caught.value.exit_code not in (0, 1)
        return
    judged = main_job(tmp_path, apply=False, edit=short(("X1",)), heard=heard)
    assert done
    right(judged, "X1")
