"""The day as it was reckoned beside the day as it was: what was pressed, mounted and restarted, and its hours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from gateway.config import DayTimes, load_site
from gateway.workflow.forecast import day_of_closing, manual_seconds
from tests.closing.presses import Presses

HOURS_WITHIN = 0.15
BLOCK_S = 1.0
# These runs stream blocks of `BLOCK_S`, a cell those of 0.25 s. A reading waits for the one that begins it and the one
# that ends it: by test 0.93 s longer at each stop (4.27 s against 3.34 s), which is no part of anybody's day.
COARSE_S = 1.24 * (BLOCK_S - 0.25)
# What a reading out of line, or a curve between targets, makes the run visit once more, in a program of its own.
UNFORESEEN = ("TFAGAIN", "TFMORE")
CAUSES = {
    "grind": "P-GRIND-PREPARED",
    "read": "P-NC-READ",
    "load": "P-PUSH-START",
    "stops": "P-PUSH-SIGN",
    "effect": "P-PUSH-EFFECT",
}


def usual_hours(simulated: DayTimes, presses: Presses, took_s: float) -> float:
    """What a run would have taken with the usual person and restart of a site file, not those of the double, h."""
    mounted, clamped, started, restarted = presses.counts
    slower = [manual_seconds(times, mounted, clamped, started, restarted) for times in (DayTimes(), simulated)]
    inspected = clamped * 60.0 * (DayTimes().inspection_min - simulated.inspection_min)
    warm = 60.0 * (DayTimes().warm_up_min - simulated.warm_up_min)
    return (took_s - presses.stops * COARSE_S + slower[0] - slower[1] + inspected + warm) / 3600.0


def unlike(site_path: Path, presses: Presses, took_s: float, within: float = HOURS_WITHIN) -> list[str]:
    """Where the forecast of a closing run is not what the run took.

    Mountings, blanks, restarts, and every press but those of measuring are to be the same. Measuring may ask for one
    press for each program that nobody foresaw, and one to begin again after it.
    """
    day = day_of_closing(load_site(site_path), site_path, apply=True)
    said = _differ(
        (
            "mountings",
            [one.component for one in day.mountings],
            [_component(one) for one in _done(presses, "mounted ")],
        ),
        ("blanks", day.blanks, len(_done(presses, "clamped "))),
        ("restarts", len(day.resets), len(presses.resets)),
    )
    foretold = Counter(CAUSES[word] for word in _words(day.presses) if word in CAUSES)
    pressed = Counter(cause.split()[0] for cause in presses.starts)
    said += _differ(*((code, foretold[code], pressed[code]) for code in sorted(set(CAUSES.values()))))
    extra = sum(any(word in cause for word in UNFORESEEN) for cause in presses.starts)
    least, found = sum(word not in CAUSES for word in _words(day.presses)), sum(pressed.values())
    measured = found - sum(pressed[code] for code in set(CAUSES.values()))
    if not least + extra <= measured <= least + 2 * extra:
        said.append(f"presses of measuring: {least} foretold, {extra} unforeseen, {measured} pressed")
    hours, was = day.hours + presses.extra_min / 60.0, took_s / 3600.0 - presses.stops * COARSE_S / 3600.0
    told = f"{day.hours:.2f} h foretold and {presses.extra_min:.0f} min for further targets, {was:.2f} h taken"
    print(f"{told} without the coarse stream's part of {took_s / 3600.0:.2f} h: {day.by_stage()}")
    if abs(hours - was) > within * was:
        said.append(told)
    return said


def _differ(*both: tuple[str, object, object]) -> list[str]:
    return [f"{name}: {foretold} foretold, {found} found" for name, foretold, found in both if foretold != found]


def _done(presses: Presses, word: str) -> list[str]:
    return [one for one in presses.handled if one.startswith(word)]


def _component(done: str) -> str:
    return done.split()[1]


def _words(causes: Sequence[str]) -> list[str]:
    return [cause.split()[0] for cause in causes]
