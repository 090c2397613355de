"""Our Modbus driver against libmodbus' server, and mbpoll against our double of the PLC."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from drivers.sinumerik.mailbox.device import SinumerikModbus
from simulators.modbus import Plc, PlcSettings, PlcStation
from simulators.nck import Nck
from tests.batches import sets_of
from tests.contract.opcua_stage import ORDER, SPEC
from tests.interop.modbus_peers import LibmodbusServer, Line, libmodbus_server, mbpoll

pytestmark = pytest.mark.interop
NCK = replace(SPEC, strict_activation=False)
DRIVER = {"needs_reference": False}


@dataclass
class Desk:
    """A control, its PLC, and a person at the panel who gives each session its release and confirms."""

    nck: Nck
    plc: Plc

    async def confirm(self) -> None:
        while True:
            await LoopClock().sleep(0.02)
            if self.plc.session and not self.plc.release.was_given:
                self.plc.release.give()
            self.plc.confirm()


@contextlib.asynccontextmanager
async def desk(**settings: Any) -> AsyncIterator[Desk]:
    nck = Nck(NCK, LoopClock(50.0))
    await nck.start()
    plc = Plc(nck, LoopClock(), PlcSettings.of(settings))
    plc.power_on()
    made = Desk(nck, plc)
    person = asyncio.get_running_loop().create_task(made.confirm())
    try:
        for axis in NCK.axes:
            nck.reference_axis(axis.name)
        while not all(nck.axis_state(axis.name).referenced for axis in NCK.axes):
            await LoopClock().sleep(0.01)
        nck.set_mode("AUTO")
        yield made
    finally:
        person.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await person
        await plc.stop()
        await nck.stop()


def run(act: Callable[[Desk], Coroutine[Any, Any, None]], **settings: Any) -> None:
    async def main() -> None:
        async with desk(**settings) as made:
            await act(made)

    asyncio.run(main())


async def push(on: Desk, url: str, **settings: Any) -> None:
    """A whole push, and what the control holds afterwards."""
    driver = SinumerikModbus("840D", url, {**DRIVER, **settings}, LoopClock())
    identity = await driver.open(10.0)
    try:
        assert (identity.serial, identity.firmware) == (SPEC.serial, SPEC.nck_version)
        assert (await driver.table_limits("C1")).reserved_points == 80
        assert (await driver.state()).axes["C1"].referenced
        await driver.stage((ORDER,))
        backup, readback = sets_of(await driver.read_back((ORDER,), 30.0))
        assert not backup.own.enabled
        assert readback.own.table.deviations == pytest.approx(ORDER.table.deviations, abs=2e-4)
        await driver.activate((ORDER,), (ORDER,))
        assert await driver.confirm((ORDER,), 30.0) == (True,)
        await driver.finish_push((ORDER,), "committed")
        marker = await driver.marker()
        assert marker is not None
        assert (marker.transaction, marker.state) == (ORDER.transaction, "committed")
    finally:
        await driver.close()
    assert on.nck.get("$MA_ENC_COMP_ENABLE[0,C1]") in (1, True)
    assert on.nck.get("$AA_ENC_COMP[0,1,C1]") == pytest.approx(ORDER.table.deviations[1] / 3600.0, abs=1e-7)


@pytest.mark.parametrize("word_order", ["high-first", "low-first"])
def test_a_push_over_tcp_through_libmodbus(word_order: str) -> None:
    async def act(on: Desk) -> None:
        async with libmodbus_server(on.plc, "tcp") as (server, port):
            await push(on, f"tcp://127.0.0.1:{port}", word_order=word_order)
            assert isinstance(server, LibmodbusServer)
            assert server.asked["W"] > 4

    run(act, word_order=word_order)


def test_a_push_over_a_serial_line_through_libmodbus() -> None:
    async def act(on: Desk) -> None:
        with Line() as line:
            async with libmodbus_server(on.plc, "rtu", line.ends[1]):
                await push(on, line.ends[0])

    run(act)


@pytest.mark.parametrize(
    ("plc", "driver", "code"),
    [
        ({"swap_words": True}, {}, "E-MBX-WORD-ORDER"),
        ({}, {"word_order": "low-first"}, "E-MBX-WORD-ORDER"),
        ({"map_version": 1}, {}, "E-MBX-OLD-MAP"),
        ({}, {"shift": 1}, "E-MBX-MAGIC"),
    ],
)
def test_another_map_is_refused_before_anything_is_written(
    plc: dict[str, Any], driver: dict[str, Any], code: str
) -> None:
    async def act(on: Desk) -> None:
        async with libmodbus_server(on.plc, "tcp") as (server, port):
            settings = {**DRIVER, **driver}
            server.shift = settings.pop("shift", 0)
            device = SinumerikModbus("840D", f"tcp://127.0.0.1:{port}", settings, LoopClock())
            try:
                with pytest.raises(TrueflankError) as caught:
                    await device.open(10.0)
            finally:
                await device.close()
            assert caught.value.code == code
            assert server.asked["W"] == 0

    run(act, **plc)


def registers(text: str) -> dict[int, int]:
    """What mbpoll printed: [address]: value, negative ones as two's complement in brackets."""
    return {int(place): int(value) & 0xFFFF for place, value in re.findall(r"\[(\d+)\]:\s+(-?\d+)", text)}


async def polled(where: list[str]) -> None:
    code, said = await mbpoll(*where[:-1], "-r", "0", "-c", "4", where[-1])
    assert code == 0, said
    assert registers(said) == {0: 0x4743, 1: 3, 2: 0x1234, 3: 0x5678}
    code, said = await mbpoll(*where[:-1], "-r", "15", where[-1], "7")
    assert "Written 1 references" in said
    code, said = await mbpoll(*where[:-1], "-r", "15", "-c", "1", where[-1])
    assert registers(said) == {15: 7}
    code, said = await mbpoll(*where[:-1], "-r", "0", where[-1], "7")
    assert code != 0
    assert "Illegal data address" in said
    code, said = await mbpoll(*where[:-1], "-r", "5000", "-c", "2", where[-1])
    assert "Illegal data address" in said


@contextlib.asynccontextmanager
async def station(on: Desk, url: str) -> AsyncIterator[PlcStation]:
    made = PlcStation(on.plc, LoopClock())
    await made.start(url)
    try:
        yield made
    finally:
        await made.stop()


def test_mbpoll_reads_and_writes_our_double_over_tcp() -> None:
    async def act(on: Desk) -> None:
        async with station(on, "tcp://127.0.0.1:0") as served:
            await polled(["-m", "tcp", "-p", served.url.rpartition(":")[2], "127.0.0.1"])

    run(act)


def test_mbpoll_reads_and_writes_our_double_over_a_serial_line() -> None:
    async def act(on: Desk) -> None:
        with Line() as line:
            async with station(on, line.ends[1]):
                await polled(["-m", "rtu", "-b", "115200", "-P", "none", line.ends[0]])

    run(act, framer="rtu")
