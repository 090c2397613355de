"""A stop plan on the kernel: its program, which counts stops and waits for the echo, placed and followed.

Words of RS274NGC as LinuxCNC's "G-Code" and "M-Code" pages give them: M68 sets an analog output, M66 waits for an
input.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, UnsupportedDevice
from drivers.exchange.lines import comment
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire
from drivers.types.moves import Going
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.units import deviation_scale

# The program.

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


def build_measuring_program(plan: StopPlan, counts: StopCounts, settings: LinuxCncSettings) -> str:
    """The whole program. StopCounts of more than 9998 stops do not exist."""
    lines = [
        f"({comment(plan.name)} {counts.token})",
        "G21 G90 G94 G40 G49 G80 G61.1",
        f"M68 E{settings.count_output} Q{counts.of(0)}",
    ]
    if plan.setup:
        lines += [f"(MSG, {_message(plan.setup)})", "M0"]
    for number, blocks in enumerate(stop_moves(plan), 1):
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


def read_moves(plan: StopPlan) -> Going:
    """What the program does with its axis, read from its own moves."""
    places = [float(_MOVE.fullmatch(block)["place"]) for blocks in stop_moves(plan) for block in blocks]  # type: ignore[index]
    return Going(
        plan.axis,
        plan.unit,
        first=places[0],
        last=places[-1],
        low=min(places),
        high=max(places),
        feeds=(plan.feed, plan.feed),
    )


def stop_moves(plan: StopPlan) -> Iterator[list[str]]:
    """The moves that lead to each stop in turn, each from its own side."""
    here: float | None = None
    stops: Sequence[Stop] = plan.stops
    for stop in stops:
        start = stop.target - stop.approach * plan.overrun
        ahead = (stop.target - here) * stop.approach if here is not None else -1.0
        moves = [stop.target] if ahead >= plan.overrun - _SAME else [start, stop.target]
        yield [f"G53 G1 {plan.letter}{place:.6f} F{plan.feed:.6f}" for place in dict.fromkeys(moves)]
        here = stop.target


# On the kernel.

_TOKENS = random.SystemRandom()


class StopProgram:
    """One program at a time; ``plan`` is the one that was sent last."""

    def __init__(self, wire: AgentWire, settings: LinuxCncSettings, clock: Clock, where: str) -> None:
        self._wire, self._settings, self._clock, self._where = wire, settings, clock, where
        self._counts = StopCounts(0)
        self._begun = False
        self.plan: StopPlan | None = None

    async def prepare(self, plan: StopPlan) -> None:
        """Place, read back and select a plan's program.

        Raises UnsupportedDevice (E-LCNC-SWITCHING, E-LCNC-STOPS), DeviceRefused (E-LCNC-BUSY, E-LCNC-PIN, ...).
        """
        if any(stop.switch is not None for stop in plan.stops):
            raise UnsupportedDevice("E-LCNC-SWITCHING", self._where)
        if len(plan.stops) >= LAST:
            raise UnsupportedDevice("E-LCNC-STOPS", self._where, stops=len(plan.stops), limit=LAST - 1)
        self._counts, self._begun, self.plan = StopCounts(_TOKENS.randrange(1, SPAN)), False, plan
        text = build_measuring_program(plan, self._counts, self._settings)
        await self._wire.write("lower", **self._inputs)
        name = "".join(char for char in plan.name if char.isalnum() and char.isascii()) or "PLAN"
        if await self._wire.write("program", name=name, text=text) != text:
            raise DeviceRefused("E-LCNC-PROGRAM", self._where, program=plan.name)

    @property
    def _inputs(self) -> dict[str, int]:
        return {"go": self._settings.go_input, "leave": self._settings.leave_input}

    async def wait(self, after: int, timeout_s: float) -> StopReached | None:
        """A stop above ``after`` with the axis in position; None once the program has ended.

        Raises DeadlineExceeded (E-LCNC-NO-STOP).
        """
        if self.plan is None:
            return None
        end, idle = self._clock.now() + timeout_s, 0
        while True:
            said = await self._wire.read("state")
            outputs = said["aout"]
            stop = self._counts.stop(outputs[self._settings.count_output])
            self._begun = self._begun or stop is not None
            idle = idle + 1 if self._begun and said["channel"] == "RESET" else 0
            if stop == LAST or idle > 1:  # ended by its own word, or by a person
                return None
            if stop is not None and stop > after:
                reached = self._reached(self.plan, stop, said["joints"])
                if reached is not None:
                    return reached
            if self._clock.now() >= end:
                raise DeadlineExceeded("E-LCNC-NO-STOP", self._where, after=after, timeout_s=timeout_s)
            await self._clock.sleep(self._settings.poll_s)

    def _reached(self, plan: StopPlan, stop: int, joints: list[dict[str, object]]) -> StopReached | None:
        found = {str(joint["letter"]): joint for joint in joints}
        if not found[plan.axis]["in_position"]:
            return None
        one, compensated = plan.stops[stop - 1], found[plan.compensated_axis]
        scale = deviation_scale("deg" if compensated["rotary"] else "mm")
        return StopReached(
            counter=stop,
            repetition=one.repetition,
            label=one.label,
            approach=one.approach,
            target=one.target,
            encoder_compensation=-float(str(compensated["trim"])) * scale,
            cross_compensation=0.0,
        )

    async def release(self, counter: int) -> None:
        """Let the program go on, once it says this very count back. Never retried."""
        told = {"go": self._settings.go_input, "echo": self._settings.echo_output}
        await self._wire.write("release", **told, counter=self._counts.of(counter))

    async def abort(self) -> None:
        """End a program of ours at its wait, now or later."""
        await self._wire.write("leave", **self._inputs)
