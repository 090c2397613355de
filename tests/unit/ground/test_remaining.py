"""The remaining time: a recorded day played again, and small days reckoned by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gateway.remaining import RemainingTime, Work

DAY = Path(__file__).parents[2] / "golden" / "days" / "close-demo.json"
WITHIN, FLOOR_S = 0.25, 60.0


def _played(day: dict[str, Any], pieces: tuple[Work, ...], every_s: float = 10.0) -> list[tuple[float, float | None]]:
    """What is said every ten seconds of the day, as (moment, seconds left)."""
    known, seen, now = RemainingTime(pieces), [], 0.0
    for told_s, code, *values in [*day["told"], (day["ended_s"], "", ())]:
        while now < told_s:
            seen.append((now, known.left_s(now)))
            now += every_s
        if code:
            known.told(code, dict(zip(day["fields"][code], values, strict=True)), told_s)
    return seen


@pytest.mark.parametrize("slower", [1.0, 1.6, 0.02])
def test_a_recorded_day_is_foretold_within_a_quarter_after_its_first_tenth(slower: float) -> None:
    """Three axes, 41 minutes of added rounds and seven mountings; also where all takes longer, or a simulator hurries.

    Near the end a quarter of nothing is nothing: there a minute of the day is allowed.
    """
    day = json.loads(DAY.read_text(encoding="ascii"))
    day["told"] = [(slower * at, *rest) for at, *rest in day["told"]]
    day["ended_s"] *= slower
    pieces = tuple(Work(stage, name, took, tuple(map(tuple, each))) for stage, name, took, each in day["pieces"])
    end = day["ended_s"]
    late = [(now, left, end - now) for now, left in _played(day, pieces, 10.0 * slower) if now > 0.1 * end]
    assert len(late) > 700
    off = [one for one in late if one[1] is None or abs(one[1] - one[2]) > WITHIN * one[2] + FLOOR_S * slower]
    assert off == []


def test_stops_of_an_axis_take_what_its_own_stops_took() -> None:
    """By hand: 4 s a stop at X where 2 s were foreseen; Z, foreseen at 3 s, then takes 6, and its mounting 100 s."""
    known = RemainingTime((Work("measure", "X1", 20.0, ((10, 20.0),)), Work("measure", "Z1", 150.0, ((30, 90.0),))))
    known.told("P-MEASURE", {"axis": "X1", "phase": "before"}, 0.0)
    for done in (1, 2, 3):
        known.told("P-STOP", {"axis": "X1", "program": "TFMEASX", "done": done, "total": 10}, 4.0 * done)
    assert known.program_left_s(12.0) == pytest.approx(28.0)
    assert known.left_s(12.0) == pytest.approx(28.0 + 30 * 6.0 + 60.0 * 2.0)
    assert known.program_left_s(14.0) == pytest.approx(26.0), "it runs down while a stop lasts"
    assert known.program_left_s(99.0) == pytest.approx(24.0), "by what one takes at most"


def test_an_added_round_counts_while_it_is_at_work_and_again_after_the_push() -> None:
    again = Work("measure again", "X1", 20.0, ((10, 20.0),))
    known = RemainingTime((Work("measure", "X1", 20.0, ((10, 20.0),)), again))
    known.told("P-MEASURE", {"axis": "X1", "phase": "before"}, 0.0)
    for done in range(1, 11):
        known.told("P-STOP", {"axis": "X1", "program": "TFMEASX", "done": done, "total": 10}, 2.0 * done)
    assert known.left_s(20.0) == pytest.approx(20.0)
    known.told("P-MORE-TARGETS", {"axis": "X1", "count": 2, "minutes": "1"}, 20.0)
    assert known.left_s(20.0) == pytest.approx(80.0)
    known.told("P-STOP", {"axis": "X1", "program": "TFMOREX", "done": 1, "total": 4}, 30.0)
    assert known.left_s(30.0) == pytest.approx(3 * 2.0 + 20.0 + 2 * 2.0)


def test_nothing_is_said_before_anything_was_seen() -> None:
    known = RemainingTime((Work("measure", "X1", 20.0, ((10, 20.0),)),))
    known.told("P-MEASURE", {"axis": "X1", "phase": "before"}, 0.0)
    assert known.left_s(1.0) is None
    assert known.program_left_s(1.0) is None
