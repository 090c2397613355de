"""Ways and repetitions of readings whose table names them in no column: by the order in which they were taken."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

FEWEST = 2
PASSES = ("", "alternate", "halves", "up", "down")


def by_order(targets: Sequence[float]) -> list[tuple[int, int]] | None:
    """(0 up or 1 down, repetition from 1) of each reading in its order; None where the order does not tell them.

    It tells where the targets are swept whole, up and down in turn: the first target that comes again begins the next
    sweep. Sweeps that all go one way may have been sorted by a program, and tell nothing.
    """
    sweeps: list[list[float]] = []
    for target in targets:
        if not sweeps or target in sweeps[-1]:
            sweeps.append([])
        sweeps[-1].append(target)
    whole = {frozenset(sweep) for sweep in sweeps}
    if len(sweeps) < FEWEST or len(whole) != 1 or len(sweeps[0]) < FEWEST:
        return None
    ways = []
    for sweep in sweeps:
        rising = {after > before for before, after in pairwise(sweep)}
        if len(rising) != 1:
            return None
        ways.append(0 if rising == {True} else 1)
    if any(before == after for before, after in pairwise(ways)):
        return None
    numbers = [ways[: at + 1].count(way) for at, way in enumerate(ways)]
    return [(way, number) for sweep, way, number in zip(sweeps, ways, numbers, strict=True) for _target in sweep]


def by_steps(targets: Sequence[float], turn: float = 0.0) -> list[int] | int:
    """0 up or 1 down for each reading, by the way from the one before; or the place of one whose side nobody can tell.

    At a turn, where a target comes twice, the second is from the new side. A step against the way so far that passes
    over other targets may be a return to the start of a pass: it tells nothing. ``turn`` (in the targets' unit; 0:
    none) is what a rotary axis counts to before it begins again: a step of more than half of it goes the other way.
    """
    steps = [after - before for before, after in pairwise(targets)]
    if turn:
        steps = [step - turn * round(step / turn) for step in steps]
    known = sorted(set(targets))
    ways: list[int] = []
    for index in range(len(targets)):
        step = steps[index - 1] if index else 0.0
        if step == 0.0:
            step = next((later for later in steps[index:] if later), 0.0)
        if step == 0.0:
            return index
        way = 0 if step > 0 else 1
        if ways and index and way != ways[-1] and abs(targets[index] - targets[index - 1]) == abs(steps[index - 1]):
            low, high = sorted((targets[index - 1], targets[index]))
            if any(low < one < high for one in known):
                return index
        ways.append(way)
    return ways


def counted(keys: Sequence[tuple[float, int]]) -> list[int]:
    """The repetition, from 1, of each reading: how often its target has come from its side so far."""
    seen: dict[tuple[float, int], int] = {}
    numbers = []
    for key in keys:
        seen[key] = seen.get(key, 0) + 1
        numbers.append(seen[key])
    return numbers


def pass_in(place: int, count: int, passes: str) -> tuple[int, int]:
    """Number, from 1, and way of the pass in this place."""
    if passes == "alternate":
        return place // 2 + 1, place % 2
    half = count // 2
    return (place % half + 1, place // half) if passes == "halves" else (place + 1, int(passes == "down"))
