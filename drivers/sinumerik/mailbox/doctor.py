"""The doctor of the Modbus road: wire, map, word order, heartbeat and fingerprint of the PLC mailbox; reads only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from drivers.checks import CheckLine, Wanted, failed, fine, identity_lines, unknown, wrong
from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.sinumerik.mailbox.codec.readings import Picture, Status
from drivers.sinumerik.mailbox.codec.registers import MAP_VERSION, StatusBit
from drivers.sinumerik.mailbox.conversation import Talk
from drivers.sinumerik.mailbox.reader import machine_of
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import ModbusWire
from drivers.sinumerik.reach import host_and_port, reach

DEFAULT_PORT = 502
_CHECKS = {
    "E-MBX-WORD-ORDER": "word order",
    "E-MBX-VERSION": "map version",
    "E-MBX-OLD-MAP": "map version",
    "E-MBX-MAGIC": "mailbox",
}


class ModbusDoctor:
    """Settings as the controller's. No register is written, so no axis is selected and no session opened."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._clock = clock
        found = ModbusSettings.read(settings, name)
        self._settings = found
        self._talk = Talk(ModbusWire(url, found, clock, name), found, clock, name)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """Every line in the order of the road. Where the road ends, the last line says what could not be asked."""
        lines = await self._road(timeout_s)
        if lines and lines[-1].outcome != "ok":
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        try:
            lines += await self._mailbox(wanted, timeout_s)
        finally:
            await self._talk.close()
        return tuple(lines)

    async def _road(self, timeout_s: float) -> list[CheckLine]:
        scheme = urlsplit(self._url).scheme if "://" in self._url else ""
        if scheme not in ("tcp", "socket"):
            return []
        secured = self._settings.secured
        protected = [fine("W-DOC-TLS", "protection") if secured else wrong("E-DOC-PLAIN", "protection")]
        try:
            host, port = host_and_port(self._url, DEFAULT_PORT)
        except ValueError as error:
            return [wrong("E-DOC-NAME", "name", host=self._url, why=str(error))]
        return [*protected, *await reach(host, port, self._clock, timeout_s)]

    async def _mailbox(self, wanted: Wanted, timeout_s: float) -> list[CheckLine]:
        try:
            status = await self._talk.begin(timeout_s)
        except TrueflankError as error:
            return [failed(error, _CHECKS.get(error.code, "answer")), unknown("W-DOC-NOT-REACHED", "rest")]
        lines = [
            fine("W-DOC-MAILBOX", "mailbox"),
            fine("W-DOC-MAP", "map version", version=MAP_VERSION),
            fine("W-DOC-ORDER", "word order", order=self._settings.word_order),
        ]
        try:
            await self._talk.alive()
            lines.append(fine("W-DOC-HEARTBEAT", "heartbeat"))
        except TrueflankError as error:
            lines.append(failed(error, "heartbeat"))
        try:
            picture = await self._talk.picture()
        except TrueflankError as error:
            return [*lines, failed(error, "registers"), unknown("W-DOC-NOT-REACHED", "rest")]
        return [*lines, *_fingerprint(picture, wanted), *_machine(picture, status)]


def _fingerprint(picture: Picture, wanted: Wanted) -> list[CheckLine]:
    counts = {"axes": picture.axes, "tables": picture.tables, "needed": len(wanted.axes)}
    enough = picture.axes >= len(wanted.axes)
    return [
        # Names of axes come one by one, by a register that selects: they are compared when the site is opened.
        *identity_lines(machine_of(picture, ()), wanted),
        fine("W-DOC-COUNTS", "axes", **counts) if enough else wrong("E-DOC-COUNTS", "axes", **counts),
    ]


def _machine(picture: Picture, status: Status) -> list[CheckLine]:
    scaling = {"basic": "in register 306", "scaling": int(picture.metric)}
    lines = [fine("W-DOC-UNITS", "units") if picture.metric else wrong("E-DOC-INCH", "units", **scaling)]
    lines.append(fine("W-DOC-WARMTH-ELSEWHERE", "temperature"))
    stale = status.has(StatusBit.RELEASE_STALE)
    lines.append(unknown("E-DOC-RELEASE", "release") if stale else fine("W-DOC-RELEASED", "release"))
    if status.session:
        lines.append(unknown("W-DOC-SESSION", "session", session=status.session))
    else:
        lines.append(fine("W-DOC-NO-SESSION", "session"))
    if not status.has(StatusBit.READY):
        lines.append(wrong("E-DOC-NOT-READY", "state"))
    else:
        names = {StatusBit.IN_RESET: "in reset", StatusBit.STANDSTILL: "standing", StatusBit.REFERENCED: "referenced"}
        shown = [name for bit, name in names.items() if status.has(bit)] + (
            ["alarm"] if status.has(StatusBit.ALARM) else []
        )
        lines.append(fine("W-DOC-BITS", "state", bits=", ".join(shown) or "-"))
    return lines
