"""The cell's connections: instruments on their wires, the ways into the control, and their keys in the site file."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from simulators.bridge import BridgeServer, SensorServer
from simulators.cellfile import CellFile, Instrument
from simulators.faults import FaultPlan
from simulators.grinding import WorkPiece
from simulators.inspection import GearInspectionServer, GearMachine
from simulators.modbus import PlcStation, make_station
from simulators.nck import Nck
from simulators.opcua import SinumerikServer
from simulators.operator import OfflineOperator
from simulators.optics import HeadReader, LaserCounter, OpticsBench, RotaryReader, SensorReader
from simulators.umd import UmdServer

Answerer = UmdServer | BridgeServer
Fetch = Callable[[], WorkPiece | None]


class Instruments:
    """Makes the answerers of one cell; ``fetch`` gives the part to inspect."""

    def __init__(
        self, bench: OpticsBench, clock: Clock, block_s: float, faults: Mapping[str, FaultPlan], fetch: Fetch
    ) -> None:
        self._bench = bench
        self._clock = clock
        self._block_s = block_s
        self._faults = faults
        self._fetch = fetch

    def all(self) -> dict[str, Answerer]:
        """Every instrument of the cell file by its name."""
        return {spec.name: self._answerer(spec) for spec in self._bench.cell.instruments}

    def _answerer(self, spec: Instrument) -> Answerer:
        bench, clock, block_s = self._bench, self._clock, self._block_s
        plan = self._faults.get(spec.name)
        around = plan.around if plan is not None else None
        match spec.kind:
            case "umd":
                return UmdServer(
                    counter=LaserCounter(spec, bench), bench=bench, clock=clock, block_s=block_s, around=around
                )
            case "bridge":
                return BridgeServer(
                    reader=RotaryReader(spec, bench), bench=bench, clock=clock, block_s=block_s, around=around
                )
            case "gear":
                return GearInspectionServer(
                    machine=GearMachine(spec, bench.truth.seed),
                    fetch=self._fetch,
                    bench=bench,
                    clock=clock,
                    around=around,
                )
            case _:
                reader = HeadReader(spec, bench) if spec.probes else SensorReader(spec, bench)
                return SensorServer(sensor=reader, bench=bench, clock=clock, block_s=block_s, around=around)


# OPC UA server, PLC mailbox, or files carried by a person.

USER = "trueflank"
# In a time that jumps nobody is kept waiting by a slow poll, and every poll costs real time.
VIRTUAL_POLL = {"poll_s": 1.0, "fast_poll_s": 0.4}
VIRTUAL_MAILBOX_POLL = {"poll_s": 1.0, "fast_poll_s": 0.05}


class ControlConnections:
    """Starts and stops what `[machine] roads` names. ``memory`` is the name of in-process wires, "" for TCP.

    ``paced``: the gateway shares this machine's clock, and its site file tells it to ask in that time's pace.
    """

    def __init__(
        self, file: CellFile, nck: Nck, clock: Clock, folder: Path, memory: str, plan: FaultPlan | None, paced: bool
    ) -> None:
        self.names = file.machine.roads
        self.password = secrets.token_urlsafe(12)
        own = {"users": {USER: self.password}, "folder": str(folder / "control")}
        self.server = SinumerikServer(nck, clock, own | file.machine.opcua)
        around = plan.around if plan is not None else None
        self.stick = folder / "carried"
        self.porter = OfflineOperator(nck, clock, self.stick) if "carried" in self.names else None
        self.plc = make_station(nck, clock, file.machine.modbus, around) if "modbus" in self.names else None
        self._site = file.site
        self._nck = nck
        self._folder = folder
        self._memory = memory
        self._paced = paced

    async def start(self) -> None:
        """Begin to listen."""
        if "opcua" in self.names:
            await self.server.start()
        if self.plc is not None:
            await self.plc.start(self._mailbox_url(self.plc))
        if self.porter is not None:
            self.porter.start()

    async def stop(self) -> None:
        """Stop listening."""
        if self.porter is not None:
            await self.porter.stop()
        if self.plc is not None:
            await self.plc.stop()
        await self.server.stop()

    async def drop_connections(self) -> None:
        """Cut every client's connection, as a pulled network cable does."""
        await self.server.drop_connections()
        if self.plc is not None:
            await self.plc.pull()
            await self.plc.plug(self.plc.home)

    def sections(self) -> dict[str, dict[str, Any]]:
        """Road -> driver, url and settings for a site file, the first road first."""
        makers = {"opcua": self._opcua_section, "modbus": self._modbus_section, "carried": self._carried_section}
        return {name: makers[name]() for name in self.names}

    def _mailbox_url(self, plc: PlcStation) -> str:
        settings = plc.plc.settings
        if isinstance(settings.port, str):
            return settings.port
        if self._memory:
            return f"memory://{self._memory}-plc"
        return f"{'socket' if settings.framer == 'rtu' else 'tcp'}://127.0.0.1:{settings.port}"

    def _opcua_section(self) -> dict[str, Any]:
        secret = self._folder / "password.txt"
        secret.touch(mode=0o600)
        secret.write_text(self.password + "\n", encoding="utf-8")
        settings: dict[str, Any] = {"user": USER, "password_file": str(secret.resolve())}
        certificate = Path(self.server.certificate)
        settings |= {"security": "best", "server_certificate": str(certificate.resolve())}
        if self._paced:
            settings |= VIRTUAL_POLL
        return {
            "driver": "sinumerik-opcua",
            "url": self.server.url,
            "settings": settings | self._site.controller_settings,
        }

    def _carried_section(self) -> dict[str, Any]:
        """No wire at all: the operator carries files."""
        axes = " ".join(axis.name for axis in self._nck.spec.axes)
        settings: dict[str, Any] = {"folder": str(self.stick.resolve()), "axes": axes}
        settings["cross_tables"] = len(self._nck.spec.cec_points)
        return {"driver": "sinumerik-offline", "url": "carried://stick", "settings": settings}

    def _modbus_section(self) -> dict[str, Any]:
        if self.plc is None:
            return {}
        plc = self.plc.plc.settings
        settings: dict[str, Any] = {"unit": plc.unit, "framer": plc.framer, "word_order": plc.word_order}
        settings["needs_reference"] = self._nck.spec.acts_from != "newconf"
        if isinstance(plc.port, str):
            settings |= {"baudrate": plc.baudrate, "parity": plc.parity}
        if self._paced:
            settings |= VIRTUAL_MAILBOX_POLL
        named = {axis.name: number for number, axis in zip(self._nck.spec.numbers, self._nck.spec.axes, strict=True)}
        if tuple(named.values()) != tuple(range(1, len(named) + 1)):
            settings["axis_numbers"] = named
        return {
            "driver": "sinumerik-modbus",
            "url": plc.client_url or self.plc.home,
            "settings": settings | self._site.modbus_settings,
        }
