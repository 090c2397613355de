"""A driver, a PLC double and its NCK in virtual time, with a person at the panel."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.types.orders import PushOrder, SignProof
from drivers.types.tables import CompensationTable, LiveSet
from simulators.modbus import PlcStation, running_station
from simulators.nck import AxisSpec
from tests.batches import sets_of
from tests.unit.nck.bench import Bench

AXES = (
    AxisSpec("X1", "X", travel=(-300.0, 700.0), eec_points=(120, 0), absolute_encoder=True),
    AxisSpec("C1", "C", rotary=True, modulo=True, eec_points=(37, 0), absolute_encoder=True),
)
SPEC: dict[str, Any] = {"axes": AXES, "cec_points": (40, 40), "strict_activation": False}


@dataclass
class Stage:
    """What a test plays with."""

    bench: Bench
    station: PlcStation
    device: SinumerikModbus

    @property
    def plc(self) -> Any:
        """The PLC's program."""
        return self.station.plc

    def get(self, name: str) -> Any:
        """A variable of the NCK."""
        return self.bench.nck.get(name)

    def values(self, count: int, axis: str = "X1") -> list[float]:
        """The first EEC points in the NCK, mm or deg."""
        return [float(self.get(f"$AA_ENC_COMP[0,{number},{axis}]")) for number in range(count)]

    def other(self, **settings: Any) -> SinumerikModbus:
        """Another driver at the same PLC, as after a restart of the PC."""
        return SinumerikModbus("grinder", self.station.url, {**_settings(self), **settings}, self.bench.clock)

    async def pressed(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Somebody at the panel presses the button whenever it is asked for, until the work is done."""
        task = asyncio.ensure_future(work)
        while not task.done():
            await self.bench.clock.sleep(0.3)
            self.plc.confirm()
        return await task

    async def push(self, order: PushOrder) -> tuple[LiveSet, LiveSet]:
        """A whole push with a willing person at the panel."""
        device = self.device
        await device.stage((order,))
        sets = sets_of(await device.read_back((order,), 200.0))
        await device.activate((order,), (order,))
        assert await self.pressed(device.confirm((order,), 100.0)) == (order.enable,)
        if order.enable:
            await device.restarted((order,), 100.0)
        await device.finish_push((order,), "committed")
        return sets


def _settings(stage: Stage) -> dict[str, Any]:
    plc = stage.plc.settings
    # As often as the PLC scans: the default serves PLCs that scan in a millisecond.
    common = {"needs_reference": False, "fast_poll_s": max(plc.scan_s, 0.001)}
    return {"framer": plc.framer, "unit": plc.unit, "word_order": plc.word_order, **common}


def table(points: int = 111, **changes: Any) -> CompensationTable:
    """An EEC table of X1 over 0..1100 mm in 10 mm, zero where the axis stands."""
    numbers = np.arange(points)
    values = np.round(12.0 * np.sin(numbers / 7.0) + 3.0 * np.sin(numbers), 3)
    given: dict[str, Any] = {"minimum": -200.0, "step": 5.0, "maximum": -200.0 + 5.0 * (points - 1)}
    values = np.round(values - np.interp(0.0, given["minimum"] + 5.0 * numbers, values), 3)
    return CompensationTable("axis", "X1", "X1", deviations=tuple(map(float, values)), **{**given, **changes})


def cross(index: int = 0, **changes: Any) -> CompensationTable:
    """A CEC table of X1 over C1, zero at 0 deg."""
    values = tuple(round(4.0 * float(np.sin(np.radians(10.0 * number))), 3) + 0.0 for number in range(37))
    given: dict[str, Any] = {"modulo": True, "index": index, "input_unit": "deg", "output_unit": "mm"}
    return CompensationTable("cross", "C1", "X1", 0.0, 360.0, 10.0, (*values[:-1], 0.0), **{**given, **changes})


async def order_for(device: SinumerikModbus, wanted: CompensationTable, number: int = 17, **changes: Any) -> PushOrder:
    """An order with a proof of this machine."""
    machine = await device.identify()
    sign = changes.pop("sign", 1)
    proof = SignProof(machine, wanted.kind, wanted.output_axis, float(sign), 0.01, sign, "2026-01-01T00:00:00+00:00")
    given: dict[str, Any] = {
        "letter": wanted.input_axis[0],
        "rotary": wanted.input_unit == "deg",
        "enable": True,
        "agreeing_position": 0.0,
        "purpose": "table",
        "proof": proof,
    }
    return PushOrder(number, wanted, **{**given, **changes})


@contextlib.asynccontextmanager
async def on_stage(
    url: str = "memory://plc",
    *,
    opened: bool = True,
    spec: dict[str, Any] | None = None,
    driver: dict[str, Any] | None = None,
    **plc: Any,
) -> AsyncIterator[Stage]:
    """The stage for the length of a test, on the running loop."""
    bench = Bench(**{**SPEC, **(spec or {})})
    await bench.nck.start()
    try:
        await bench.warm_up()
        async with running_station(bench.nck, bench.clock, plc, url) as station:
            stage = Stage(bench, station, None)  # type: ignore[arg-type]
            station.plc.on_session = station.plc.release.give
            stage.device = stage.other(**(driver or {}))
            try:
                if opened:
                    await stage.device.open(5.0)
                yield stage
            finally:
                await stage.device.close()
    finally:
        await bench.nck.stop()
