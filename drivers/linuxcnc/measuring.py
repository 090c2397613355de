"""A stop plan on the kernel: place its program, see it count, let it go on."""

from __future__ import annotations

import random

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, UnsupportedDevice
from drivers.linuxcnc.program import LAST, SPAN, StopCounts, measuring
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire
from drivers.types.stops import StopPlan, StopReached
from drivers.units import deviation_scale

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
        text = measuring(plan, self._counts, self._settings)
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
