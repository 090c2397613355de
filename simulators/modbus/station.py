"""The PLC on its wires: Modbus TCP or RTU, over TCP, memory:// or a serial port, with mains that can fail."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from typing import Any

from drivers.clock import Clock, LoopClock
from drivers.errors import TransportError
from drivers.transport import ByteTransport, open_transport
from simulators.instrument_server import InstrumentServer, WireWrapper
from simulators.modbus.frames import BrokenFrame, Framing, Mbap, ModbusFrame, NoAnswer, Rtu, answer_pdu
from simulators.modbus.plc import Plc
from simulators.modbus.settings import PlcSettings
from simulators.nck import Nck

READ_BYTES = 4096
GATEWAY_TARGET_FAILED = 0x0B
BROADCAST = 0
# A device that is no gateway is addressed by either of these on TCP (Messaging Guide 4.4.2).
_TCP_ITSELF = frozenset({0xFF})
OPEN_S = 10.0
_BOOT_LOOK_S = 0.1


class PlcStation(InstrumentServer):
    """One PLC, one wire. `around` may put faults around each connection; `silent` answers nothing."""

    def __init__(self, plc: Plc, clock: Clock, around: WireWrapper | None = None) -> None:
        super().__init__(clock, 1.0, around)
        self.plc = plc
        self.served = 0
        self._wall = LoopClock()
        self._home = ""
        self._line: asyncio.Task[None] | None = None
        self._outage: asyncio.Task[None] | None = None
        plc.on_power_cut = self._fail

    # -- life --------------------------------------------------------------------------------------

    async def start(self, url: str) -> str:
        """Switch on and listen (tcp://, socket://, memory://) or open a serial port; the url for clients."""
        self.plc.power_on()
        return await super().start(url)

    @property
    def home(self) -> str:
        """Where it listens, or listened before the line was pulled."""
        return self._home

    async def plug(self, url: str) -> str:
        """Listen (again) on this url."""
        self._home = url
        if "://" not in url:
            settings = self.plc.settings
            wire = await open_transport(url, self._wall, OPEN_S, baudrate=settings.baudrate, parity=settings.parity)
            self._line = asyncio.get_running_loop().create_task(self._on_line(wire), name=f"plc on {url}")
            return url
        self._home = await super().plug(url)
        return self._home

    async def pull(self) -> None:
        """Pull the line: connections end, nobody listens."""
        line, self._line = self._line, None
        await _ended(line)
        await super().pull()

    async def stop(self) -> None:
        """End everything."""
        await _ended(self._outage)
        await super().stop()
        await self.plc.stop()

    # -- the mains ---------------------------------------------------------------------------------

    def _fail(self) -> None:
        self._outage = asyncio.get_running_loop().create_task(self.power_cycle(), name="mains")

    async def power_cycle(self) -> None:
        """The mains of PLC and NCK fail and come back; ends when both are up and listening again."""
        self.plc.power_off()
        nck = self.plc.nck
        nck.power_cycle()
        await self.pull()
        while nck.booting:
            await self._clock.sleep(_BOOT_LOOK_S)
        self.plc.power_on()
        await self.plug(self._home)

    # -- the talk ----------------------------------------------------------------------------------

    def _skip_to(self, now_s: float) -> None:
        """A PLC samples nothing."""

    async def _produce(self) -> None:
        """A PLC streams nothing."""

    async def _on_line(self, wire: ByteTransport) -> None:
        try:
            with contextlib.suppress(TransportError):  # somebody pulled the serial cable
                await self._visited(wire)
        finally:
            await wire.close()

    async def _converse(self, peer: ByteTransport) -> None:
        framing: Framing = Rtu() if self.plc.settings.framer == "rtu" else Mbap()
        with contextlib.suppress(BrokenFrame):
            while True:
                data = await peer.read(READ_BYTES)
                echo = data if self.plc.settings.local_echo else b""
                for frame in framing.feed(data, self._wall.now()):
                    reply = self._reply(frame)
                    if reply is not None and not self.silent:
                        await peer.write(echo + bytes(self.plc.settings.leading_zeros) + framing.wrap(reply))
                        echo = b""
                if echo:
                    await peer.write(echo)

    def _reply(self, frame: ModbusFrame) -> ModbusFrame | None:
        """The answer to one request; None for what nobody here answers."""
        self.served += 1
        settings = self.plc.settings
        rtu = settings.framer == "rtu"
        mine = frame.unit == settings.unit or (not rtu and frame.unit in _TCP_ITSELF)
        if not mine:
            if rtu or frame.unit == BROADCAST:
                return None
            return ModbusFrame(frame.unit, bytes((frame.pdu[0] | 0x80, GATEWAY_TARGET_FAILED)), frame.transaction)
        try:
            return ModbusFrame(frame.unit, answer_pdu(frame.pdu, self.plc), frame.transaction)
        except NoAnswer:
            return None


async def _ended(task: asyncio.Task[None] | None) -> None:
    if task is not None:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def make_station(nck: Nck, clock: Clock, settings: Mapping[str, Any], around: WireWrapper | None = None) -> PlcStation:
    """A station with a PLC of its own. Raises ConfigError for unknown settings."""
    return PlcStation(Plc(nck, clock, PlcSettings.of(settings)), clock, around)


@contextlib.asynccontextmanager
async def running_station(
    nck: Nck, clock: Clock, settings: Mapping[str, Any] | None = None, url: str = "tcp://127.0.0.1:0"
) -> AsyncIterator[PlcStation]:
    """A station for the length of a block; reach it by its ``url``."""
    station = make_station(nck, clock, settings or {})
    try:
        await station.start(url)
        yield station
    finally:
        await station.stop()
