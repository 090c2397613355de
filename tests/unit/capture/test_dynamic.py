"""Dynamic capture: every sample handed on once, in order, with its gaps, from the trigger on, in bounded memory."""

from __future__ import annotations

import asyncio
import tracemalloc
from collections.abc import AsyncIterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, TransportError
from drivers.message import Message
from drivers.types.sensing import SampleBlock
from gateway.capture.dynamic import CaptureEnd, DynamicCapture, LiveView, StreamShape, Trigger
from gateway.errors import CaptureError
from gateway.store.raw_stream import RawRecorder, StreamFacts, open_stream

CHANNELS = ("displacement_mm",)
RATE_HZ = 1000.0


class Kept:
    """A sink that remembers."""

    def __init__(self) -> None:
        self.pieces: list[np.ndarray] = []
        self.gaps: list[tuple[int, int]] = []
        self.facts: StreamShape | None = None

    def begin(self, facts: StreamShape) -> Kept:
        self.facts = facts
        return self

    def append(self, block: np.ndarray, lost: int = 0) -> None:
        if lost:
            self.gaps.append((sum(map(len, self.pieces)), lost))
        self.pieces.append(np.array(block))

    @property
    def values(self) -> np.ndarray:
        return np.concatenate(self.pieces) if self.pieces else np.empty(0)


def block(start: int, count: int, lost: int = 0, zero_s: float = 0.0, **more: Any) -> SampleBlock:
    """Samples number start .. start+count-1; a sample's value is its number in mm/1000, so um is the number."""
    index = np.arange(start, start + count)
    valid = np.ones(count, dtype=np.bool_)
    return SampleBlock(CHANNELS, zero_s + index / RATE_HZ, (index / 1000.0)[:, None], valid, lost, **more)


def follow(blocks: list[SampleBlock], seconds: float = 1.0, **options: Any) -> tuple[Kept, CaptureEnd]:
    kept = Kept()

    async def stream() -> AsyncIterator[SampleBlock]:
        for one in blocks:
            yield one

    capture = DynamicCapture(CHANNELS, seconds, kept.begin, **options)
    return kept, asyncio.run(capture.follow(stream()))


def cut(total: int, edges: list[int]) -> list[SampleBlock]:
    places = [0, *sorted(set(edges)), total]
    return [block(start, stop - start) for start, stop in pairwise(places) if stop > start]


@given(st.lists(st.integers(1, 1999), max_size=30))
def test_however_a_stream_is_cut_the_record_is_the_same(edges: list[int]) -> None:
    kept, ended = follow(cut(2000, edges))
    assert ended == CaptureEnd("complete", 1000, 0)
    np.testing.assert_array_equal(kept.values, np.arange(1000) / 1000.0)
    assert kept.facts == StreamShape("displacement_mm", RATE_HZ, "um", 1000.0, None)


def test_lost_samples_are_counted_where_they_are_missing() -> None:
    kept, ended = follow([block(0, 100), block(150, 100, lost=50), block(250, 900)])
    assert kept.gaps == [(100, 50)]
    assert (ended.samples, ended.lost) == (1000, 50)
    assert kept.values[100] == 0.15


def test_a_jump_of_the_clock_forward_is_a_gap_though_nothing_was_counted() -> None:
    kept, ended = follow([block(0, 100), block(150, 1000)])
    assert kept.gaps == [(100, 50)]
    assert "samples missing: 50 by the clock" in str(ended.notes[0])


@pytest.mark.parametrize("second", [block(50, 100), block(0, 100), block(100, 100, zero_s=-1.0)])
def test_fault_28_and_37_time_that_goes_back_ends_the_capture_and_keeps_what_was(second: SampleBlock) -> None:
    kept = Kept()
    capture = DynamicCapture(CHANNELS, 1.0, kept.begin)
    capture.take(block(0, 100))
    with pytest.raises(CaptureError, match="E-CAP-CLOCK"):
        capture.take(second)
    assert len(kept.values) == 100


def test_uneven_times_within_a_block_are_refused() -> None:
    times = np.array([0.0, 0.001, 0.002, 0.004, 0.005])
    uneven = SampleBlock(CHANNELS, times, np.zeros((5, 1)), np.ones(5, dtype=np.bool_))
    with pytest.raises(CaptureError, match="E-CAP-CLOCK"):
        follow([uneven])


def test_fault_21_a_lost_beam_ends_the_record_at_the_last_good_sample() -> None:
    broken = block(100, 100)
    broken.valid[40:] = False
    kept, ended = follow([block(0, 100), broken, block(200, 900)])
    assert (ended.why, ended.samples) == ("beam", 140)
    assert kept.values[-1] == 0.139
    assert "0.140" in str(ended.notes[0])


def test_a_stream_that_ends_keeps_what_came() -> None:
    kept, ended = follow([block(0, 100)])
    assert (ended.why, len(kept.values)) == ("stream", 100)


@settings(max_examples=80)
@given(st.lists(st.integers(1, 2999), max_size=20), st.integers(0, 700), st.integers(1, 1400))
def test_a_trigger_keeps_what_was_before_it_however_the_stream_is_cut(edges: list[int], pre: int, at: int) -> None:
    trigger = Trigger("level", at - 0.5, pre / RATE_HZ)
    kept, ended = follow(cut(3000, edges), 0.5, trigger=trigger)
    first = max(at - pre, 0)
    assert ended.why == "complete"
    assert kept.facts is not None
    assert kept.facts.trigger == at - first
    np.testing.assert_array_equal(kept.values, np.arange(first, at + 500) / 1000.0)


@pytest.mark.parametrize("at", [("external", 0.0), ("value", 250.0), ("level", 250.0)])
def test_triggers_by_what_they_are_called(at: tuple[Any, float]) -> None:
    blocks = [block(start, 100) for start in range(0, 2000, 100)]
    blocks[2] = replace(blocks[2], events=(Message.of("W-BRIDGE-EVENT", kind="trigger", at_s=0.25),))
    kept, _ended = follow(blocks, 0.1, trigger=Trigger(at[0], at[1], 0.02))
    assert kept.values[0] == pytest.approx(0.230)
    assert len(kept.values) == 120


def test_a_gap_before_the_trigger_stays_known() -> None:
    blocks = [block(0, 100), block(150, 100, lost=50), block(250, 1000)]
    kept, ended = follow(blocks, 0.2, trigger=Trigger("level", 299.5, 0.17))
    assert kept.gaps == [(20, 50)]  # 150 kept samples: 20 before the gap ... 300
    assert ended.lost == 50


def test_the_live_view_is_decimated_and_sees_everything() -> None:
    seen: list[LiveView] = []
    follow([block(start, 10) for start in range(0, 5000, 10)], 5.0, view=seen.append, views_per_s=2.0)
    assert 9 <= len(seen) <= 11
    assert seen[0].low == 0.0
    assert max(one.high for one in seen) >= 4500.0
    assert seen[-1].samples > 4000


@pytest.mark.parametrize(
    ("channels", "options", "code"),
    [
        (("displacement_mm",), {"channel": "angle_deg"}, "E-CAP-CHANNEL"),
        (("strange_furlong",), {}, "E-CAP-CHANNEL"),
        ((), {}, "E-CAP-CHANNEL"),
    ],
)
def test_what_cannot_be_captured_is_refused(channels: tuple[str, ...], options: dict[str, Any], code: str) -> None:
    with pytest.raises(ConfigError, match=code):
        DynamicCapture(channels, 1.0, Kept().begin, **options)


def test_an_hour_of_50_khz_passes_in_bounded_memory_and_a_pulled_wire_keeps_it(tmp_path: Path) -> None:
    """The stream is shortened in values, not in kind: 400 blocks of 5 000 samples, then the wire is gone."""
    recorder: list[RawRecorder] = []

    def begin(facts: StreamShape) -> RawRecorder:
        made = RawRecorder(tmp_path, "c", StreamFacts(facts.rate_hz, facts.unit, facts.scale, facts.trigger))
        recorder.append(made)
        return made

    async def stream() -> AsyncIterator[SampleBlock]:
        valid, values = np.ones(5000, dtype=np.bool_), np.zeros((5000, 1))
        for number in range(400):
            yield SampleBlock(CHANNELS, (number * 5000 + np.arange(5000)) / 50_000.0, values, valid)
        raise TransportError("E-LINK-CLOSED", "laser", why="pulled")

    capture = DynamicCapture(CHANNELS, 3600.0, begin, trigger=Trigger("none", 0.0, 0.5))
    tracemalloc.start()
    with pytest.raises(TransportError):
        asyncio.run(capture.follow(stream()))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    recorder[0].close()
    assert peak < 2_000_000
    assert len(open_stream(tmp_path / "c.f64")) == 400 * 5000
    assert capture.ended("stream").samples == 400 * 5000


def test_waiting_for_a_trigger_holds_no_more_than_asked() -> None:
    capture = DynamicCapture(CHANNELS, 1.0, Kept().begin, trigger=Trigger("level", 1e9, 0.1))
    for number in range(300):
        capture.take(block(number * 1000, 1000))
    assert sum(len(piece) for piece, _lost in capture._pre) <= 100
