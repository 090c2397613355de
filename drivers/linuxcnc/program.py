"""A stop plan as a program for LinuxCNC: go there, count, wait until the gateway has read, say the count back; pure.

Words of RS274NGC as LinuxCNC's "G-Code" and "M-Code" pages give them: M68 sets an analog output at once, after the
motion before it; M66 L3 waits for a high input and L4 for a low one, #5399 is -1 when the time has passed; L0 reads.
Moves are in machine coordinates (G53), a rotary axis alone moves in deg/min (G94).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.exchange.lines import comment
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.types.moves import Going
from drivers.types.stops import Stop, StopPlan

SPAN = 10_000
LAST = SPAN - 1
"""StopCounts of one program lie in a span of their own, so that an output left by another program is none of them."""
ECHO_S = 10
_SAME = 1e-9
_MOVE = re.compile(r"G53 G1 [A-Z](?P<place>-?[\d.]+) F[\d.]+")


@dataclass(frozen=True, slots=True)
class StopCounts:
    """The counts of one program: ``token`` names it."""

    token: int

    def of(self, stop: int) -> int:
        """What stands in the output while the axis waits at this stop (1 ..); 0: begun."""
        return self.token * SPAN + stop

    def stop(self, value: float) -> int | None:
        """Which stop an output means; None where it is of another program, `LAST` once this one has ended."""
        token, stop = divmod(round(value), SPAN)
        return stop if token == self.token else None


def measuring(plan: StopPlan, counts: StopCounts, settings: LinuxCncSettings) -> str:
    """The whole program. StopCounts of more than 9998 stops do not exist."""
    lines = [
        f"({comment(plan.name)} {counts.token})",
        "G21 G90 G94 G40 G49 G80 G61.1",
        f"M68 E{settings.count_output} Q{counts.of(0)}",
    ]
    if plan.setup:
        lines += [f"(MSG, {_message(plan.setup)})", "M0"]
    for number, blocks in enumerate(legs(plan), 1):
        lines += [*blocks, *_wait(plan, number, counts, settings)]
    return "\n".join([*lines, *_end(counts, settings)]) + "\n"


def _message(text: str) -> str:
    """Round brackets would end the message, a percent sign the file."""
    return comment(text).replace("(", "[").replace(")", "]").replace("%", "percent")


def _end(counts: StopCounts, settings: LinuxCncSettings) -> list[str]:
    return [f"M68 E{settings.count_output} Q{counts.of(LAST)}", "M2"]


def _wait(plan: StopPlan, number: int, counts: StopCounts, settings: LinuxCncSettings) -> list[str]:
    end = [f"  {line}" for line in _end(counts, settings)]
    label = 100 + 2 * number
    return [
        f"G4 P{plan.dwell_s:.3f}",
        f"M68 E{settings.count_output} Q{counts.of(number)}",
        f"M66 P{settings.go_input} L3 Q{settings.wait_limit_s:.0f}",
        f"O{label} IF [#5399 LT 0]",
        *end,
        f"O{label} ENDIF",
        f"M66 P{settings.leave_input} L0",
        f"O{label + 1} IF [#5399 GT 0.5]",
        *end,
        f"O{label + 1} ENDIF",
        f"M68 E{settings.echo_output} Q{counts.of(number)}",
        f"M66 P{settings.go_input} L4 Q{ECHO_S}",
    ]


def going_of(plan: StopPlan) -> Going:
    """What the program does with its axis, read from its own moves."""
    places = [float(_MOVE.fullmatch(block)["place"]) for blocks in legs(plan) for block in blocks]  # type: ignore[index]
    return Going(
        plan.axis,
        plan.unit,
        first=places[0],
        last=places[-1],
        low=min(places),
        high=max(places),
        feeds=(plan.feed, plan.feed),
    )


def legs(plan: StopPlan) -> Iterator[list[str]]:
    """The moves that lead to each stop in turn, each from its own side."""
    here: float | None = None
    stops: Sequence[Stop] = plan.stops
    for stop in stops:
        start = stop.target - stop.approach * plan.overrun
        ahead = (stop.target - here) * stop.approach if here is not None else -1.0
        moves = [stop.target] if ahead >= plan.overrun - _SAME else [start, stop.target]
        yield [f"G53 G1 {plan.letter}{place:.6f} F{plan.feed:.6f}" for place in dict.fromkeys(moves)]
        here = stop.target
