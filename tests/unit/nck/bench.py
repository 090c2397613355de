"""A control on the bench for these tests: axes X1, Y1, Z1, C1, a clock in virtual time, a person's hands."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import AsyncIterator

from drivers.clock import LoopClock
from simulators.nck import AxisSpec, Nck, NckSpec

SPEC = NckSpec(
    axes=(
        AxisSpec("X1", "X", travel=(-300.0, 700.0), eec_points=(900, 10)),
        AxisSpec("Y1", "Y", travel=(-100.0, 100.0)),
        AxisSpec("Z1", "Z", travel=(-100.0, 600.0), eec_points=(60, 0)),
        AxisSpec("C1", "C", rotary=True, modulo=True, max_velocity=7200.0, eec_points=(80, 0)),
    ),
    cec_points=(20, 20, 20, 20),
    files_max_bytes=2_000_000,
    judges_programs=False,  # the interpreter behind the gate is tried here
)
MAIN = "/_N_MPF_DIR/_N_TEST_MPF"


class Bench:
    """A control, switched on, and what one does with it."""

    def __init__(self, **changes: object) -> None:
        self.clock = LoopClock()
        self.nck = Nck(dataclasses.replace(SPEC, **changes), self.clock)

    async def sleep(self, seconds: float) -> None:
        await self.clock.sleep(seconds)

    async def warm_up(self) -> None:
        """Reference all axes and choose AUTO, as in the morning."""
        for axis in self.nck.spec.axes:
            assert self.nck.reference_axis(axis.name)
        for _ in range(1000):
            await self.sleep(0.2)
            if all(self.nck.axis_state(axis.name).referenced for axis in self.nck.spec.axes):
                break
        assert self.nck.set_mode("AUTO")

    async def reset_and_reference(self) -> None:
        self.nck.nck_reset()
        while self.nck.booting:
            await self.sleep(0.2)
        await self.warm_up()

    def load(self, text: str, path: str = MAIN) -> None:
        self.nck.files.write(path, text.encode("latin-1"))

    def press_start(self, text: str) -> None:
        self.load(text)
        assert self.nck.select(MAIN) == 0
        assert self.nck.nc_start()

    async def run(self, text: str, limit_s: float = 600.0) -> None:
        """Run a program until the channel is no longer active."""
        self.press_start(text)
        await self.until_idle(limit_s)

    async def until_idle(self, limit_s: float = 600.0) -> None:
        end = self.clock.now() + limit_s
        while self.nck.channel_status == 1:
            assert self.clock.now() < end, "the program does not come to its end"
            await self.sleep(0.05)

    def numbers(self) -> list[int]:
        return [alarm.number for alarm in self.nck.alarms]

    def r(self, number: int) -> float:
        value = self.nck.get(f"R[{number}]")
        assert isinstance(value, float)
        return value


@contextlib.asynccontextmanager
async def on_bench(*, warm: bool = True, **changes: object) -> AsyncIterator[Bench]:
    """A fresh control for the length of a test."""
    bench = Bench(**changes)
    await bench.nck.start()
    try:
        if warm:
            await bench.warm_up()
        yield bench
    finally:
        await bench.nck.stop()


def eec_lines(axis: str, values: list[float], minimum: float, step: float, modulo: int = 0) -> str:
    """The lines of a table for encoder 1."""
    top = minimum + step * (len(values) - 1)
    lines = [
        f"$AA_ENC_COMP_STEP[0,{axis}]={step} $AA_ENC_COMP_MIN[0,{axis}]={minimum}",
        f"$AA_ENC_COMP_MAX[0,{axis}]={top} $AA_ENC_COMP_IS_MODULO[0,{axis}]={modulo}",
    ]
    lines += [f"$AA_ENC_COMP[0,{place},{axis}]={value:.6f}" for place, value in enumerate(values)]
    return "\n".join(lines) + "\n"


def enable(axis: str, state: int) -> str:
    return f"$MA_ENC_COMP_ENABLE[0,{axis}]={state}\nNEWCONF\nSTOPRE\n"


async def load_eec(bench: Bench, axis: str, values: list[float], minimum: float, step: float, modulo: int = 0) -> None:
    """Write a table, switch it on, boot and reference."""
    await bench.run(enable(axis, 0) + eec_lines(axis, values, minimum, step, modulo) + enable(axis, 1) + "M30")
    assert bench.numbers() == []
    await bench.reset_and_reference()
