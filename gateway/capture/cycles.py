"""In which order targets are visited: standard, step (pendulum) and pilgrim cycles; pure.

ISO 230-2 reports rest on the standard cycle alone: all targets up, all down, again and again. The step cycle
swings over each target before it goes on; the pilgrim cycle goes up and down over a few targets, then on to the
next few. Both lose less to drift and more to local heating, and are reported as what they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np

from drivers.types.stops import Stop
from drivers.types.values import FloatArray

Cycle = Literal["standard", "pendulum", "pilgrim"]
SECTION = 4


def visits(cycle: Cycle, targets: FloatArray, repetitions: int) -> tuple[Stop, ...]:
    """Every (target, repetition, approach) once; ``targets`` (m,) ascending, a stop's label is its index."""
    chosen: dict[str, Callable[[FloatArray, int], Iterator[Stop]]]
    chosen = {"standard": _standard, "pendulum": _pendulum, "pilgrim": _pilgrim}
    return tuple(chosen[cycle](targets, repetitions))


def _up_and_down(targets: FloatArray, indices: range, repetition: int) -> Iterator[Stop]:
    for index in indices:
        yield Stop(float(targets[index]), 1, repetition, index)
    for index in reversed(indices):
        yield Stop(float(targets[index]), -1, repetition, index)


def _standard(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for repetition in range(repetitions):
        yield from _up_and_down(targets, range(len(targets)), repetition)


def _pendulum(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for index in range(len(targets)):
        for repetition in range(repetitions):
            yield from _up_and_down(targets, range(index, index + 1), repetition)


def _pilgrim(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for repetition in range(repetitions):
        for start in range(0, len(targets), SECTION):
            yield from _up_and_down(targets, range(start, min(start + SECTION, len(targets))), repetition)


def with_window(targets: FloatArray, window: FloatArray) -> FloatArray:
    """Targets of the full travel and of a working window together, ascending.

    Within the window its own points stand; a target of the travel gives way where a point of the window lies
    nearer than half the window's step.
    """
    if len(window) < 2:
        return targets
    step = float(np.min(np.diff(window)))
    nearest = np.min(np.abs(targets[:, None] - window[None, :]), axis=1)
    return np.sort(np.concatenate([targets[nearest >= 0.5 * step], window]))
