"""The live stream: envelopes ten times a second, a bounded queue for each page, the newest kept and the loss told."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock
from drivers.message import Message
from drivers.types.sensing import Ambient, SampleBlock
from gateway.daemon.stream import LONGEST_QUEUE, MOST_ASKED, MOST_LISTENERS, Hub, LiveObserver
from gateway.errors import BusyError
from gateway.live import LiveDeviation


def told(frames: str) -> list[tuple[str, dict[str, Any]]]:
    """Events of a piece of stream."""
    found = []
    for frame in frames.strip().split("\n\n"):
        lines = dict(text.split(": ", 1) for text in frame.split("\n"))
        found.append((lines["event"], json.loads(lines["data"])))
    return found


async def test_a_page_gets_the_picture_then_what_happens_in_order() -> None:
    hub = Hub(LoopClock(), lambda: {"state": "ready"})
    listener = hub.join()
    hub.hear("P-STOP", {"axis": "X1", "program": "p", "done": 1, "total": 2})
    hub.tell("state", {"state": "running"})
    events = told(await listener.next(LoopClock()))
    assert [kind for kind, _data in events] == ["picture", "said", "state"]
    assert events[1][1]["fields"]["done"] == 1
    assert "words" in events[1][1]


async def test_a_slow_page_loses_the_oldest_is_told_and_slows_nobody() -> None:
    now = {"step": "first"}
    hub = Hub(LoopClock(), lambda: now)
    slow, quick = hub.join(), hub.join()
    await quick.next(LoopClock())
    hub.hear("P-START", {"axis": "X1", "program": "TFMEASX"})
    await quick.next(LoopClock())
    now["step"] = "second"
    for number in range(LONGEST_QUEUE + 48):
        hub.tell("reading", {"number": number})
        assert told(await quick.next(LoopClock()))[-1][1]["number"] == number
    events = told(await slow.next(LoopClock()))
    assert events[0] == ("lost", {"frames": 50})
    assert [kind for kind, _data in events[1:3]] == ["picture", "said"], (
        "a word outlives what the next reading replaces"
    )
    assert [data["number"] for _kind, data in events[3:-1]] == list(range(50, LONGEST_QUEUE + 48))
    assert events[-1] == ("picture", {"step": "second"})
    assert (hub.dropped, quick.lost) == (50, 0)


async def test_a_stream_beats_while_nothing_happens_and_ends_with_the_gateway() -> None:
    hub = Hub(LoopClock(), dict)
    frames = []
    async for frame in hub.stream(hub.join()):
        frames.append(frame)
        if len(frames) == 2:
            hub.end()
    assert told(frames[1]) == [("beat", {})], "a page hears it: a comment would never reach its script"
    assert hub.listening == 0


async def test_a_page_hears_something_every_five_seconds() -> None:
    """Two that are missed mean a cut cable: no socket tells of one."""
    clock = LoopClock()
    hub = Hub(clock, dict)
    listener, before = hub.join(), clock.now()
    await listener.next(clock)
    for _beat in range(3):
        assert told(await listener.next(clock)) == [("beat", {})]
    assert clock.now() - before == pytest.approx(15.0)


async def test_only_so_many_listen() -> None:
    hub = Hub(LoopClock(), dict)
    for _page in range(MOST_LISTENERS):
        hub.join()
    with pytest.raises(BusyError):
        hub.join()


def block(first: int, count: int, *, bad: int = 0) -> SampleBlock:
    times = np.arange(first, first + count) / 50_000.0
    values = np.sin(times * 50.0)[:, None]
    valid = np.ones(count, dtype=np.bool_)
    valid[:bad] = False
    return SampleBlock(("displacement_mm",), times, values, valid, lost=3 if bad else 0)


async def test_readings_of_50_khz_go_out_ten_times_a_second_and_hide_no_sample() -> None:
    frames: list[dict[str, Any]] = []
    clock = LoopClock()
    looking = LiveObserver(lambda _kind, data: frames.append(dict(data)), clock)
    every = [block(number * 500, 500, bad=5 if number == 7 else 0) for number in range(200)]
    for one in every:
        looking.samples("laser", one)
        await clock.sleep(0.01)
    looking.samples("laser", block(100_000, 1))
    await clock.sleep(0.1)
    looking.samples("laser", block(100_001, 1))
    assert 18 <= len(frames) <= 22
    assert frames[-1]["sequence"] == sum(one["count"] for one in frames) == 100_002
    assert min(one["low"][0] for one in frames) == min(float(one.values.min()) for one in every)
    assert max(one["high"][0] for one in frames) == max(float(one.values.max()) for one in every)
    assert sum(one["lost"] for one in frames) == 3
    assert sum(one["signal"] < 1.0 for one in frames) == 1


async def test_what_is_waited_for_is_told_seldom_and_finite() -> None:
    frames: list[dict[str, Any]] = []
    looking = LiveObserver(lambda _kind, data: frames.append(dict(data)), LoopClock())
    for _time in range(5):
        looking.waiting("laser", Message.of("W-WAIT-SAMPLES"), -np.inf, 2.0)
    assert frames == [
        {"instrument": "laser", "missing": {"code": "W-WAIT-SAMPLES", "fields": {}}, "done_s": 0.0, "needed_s": 2.0}
    ]


async def test_a_reading_is_asked_for_again_once_and_not_without_end() -> None:
    looking = LiveObserver(lambda _kind, _data: None, LoopClock())
    assert all(looking.ask_again("X1", (float(number), 0, 1)) for number in range(MOST_ASKED))
    assert not looking.ask_again("X1", (0.0, 0, 1))
    assert looking.ask_again("C1", (0.0, 0, 1))
    assert len(looking.asked_again("X1")) == MOST_ASKED
    assert looking.asked_again("X1") == ()


async def test_targets_that_join_a_capture_stand_with_those_taken_before() -> None:
    looking = LiveObserver(lambda _kind, _data: None, LoopClock())
    for code, target in (("P-MEASURE", 0.0), ("P-STOP", 10.0), ("P-MORE-TARGETS", 5.0), ("P-SETUP", 0.0)):
        looking.said(code, {})
        looking.taken("X1", (target, 1, 1), LiveDeviation(0.1, "um", 0.4, 5.0))
    parts = [one["part"] for one in looking.kept]
    assert parts[0] == parts[1] == parts[2] != parts[3]


async def test_air_is_in_the_first_picture_of_a_page_that_is_opened_again() -> None:
    clock = LoopClock()
    looking = LiveObserver(lambda _kind, _data: None, clock)
    assert looking.air is None
    looking.ambient("laser", Ambient(21.3, 1002.0, 44.0, (20.6, 20.7), age_s=2.0))
    assert looking.air is not None
    assert (looking.air["air_degc"], looking.air["material_degc"]) == (21.3, [20.6, 20.7])
    assert str(looking.air["utc"]).endswith("+00:00")


async def test_air_is_kept_over_the_command_and_a_new_one_begins_anew() -> None:
    looking = LiveObserver(lambda _kind, _data: None, LoopClock())
    for degc in (21.3, 21.4, 21.6):
        looking.ambient("laser", Ambient(degc, 1002.0, 44.0, (20.6,)))
    assert [one["air_degc"] for one in looking.airs] == [21.3, 21.4, 21.6]
    looking.begin()
    assert list(looking.airs) == []
    assert looking.air is not None, "what was read last is still known"


async def test_where_axes_stand_is_told_when_one_stands_elsewhere() -> None:
    frames: list[tuple[str, Any]] = []
    looking = LiveObserver(lambda kind, data: frames.append((kind, dict(data))), LoopClock())
    for positions in ({"X1": 100.0, "Z1": 0.0}, {"X1": 100.000004}, {"X1": 150.0}, {}):
        looking.stands(positions)
    assert frames == [
        ("stands", {"positions": {"X1": 100.0, "Z1": 0.0}}),
        ("stands", {"positions": {"X1": 150.0, "Z1": 0.0}}),
    ]
