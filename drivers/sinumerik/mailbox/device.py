"""The SINUMERIK 840D behind a PLC mailbox on Modbus TCP or RTU, as a Controller without motion programs; its doctor.

Tables are loaded, read back and switched by the PLC (docs/plc-mailbox.md); a person confirms at the panel. The operator
moves the axes: a site with this connection alone measures by dwell or from files. Compensation values come in um or
arcsec, positions in mm or deg. Reads may be repeated by the caller, a write never: after a timeout what the PLC did is
unknown, and `open` makes a fresh connection.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import urlsplit

from drivers.checks import CheckLine, Wanted, failed, fine, identity_lines, unknown, wrong
from drivers.clock import Clock
from drivers.errors import TrueflankError, UnsupportedDevice
from drivers.ports.devices import Tell
from drivers.safe_positions import SafePositionMixin
from drivers.sinumerik.mailbox.codec.frames import Picture, Status
from drivers.sinumerik.mailbox.codec.registers import KINDS, MAP_VERSION, StatusBit
from drivers.sinumerik.mailbox.conversation import PlcConversation
from drivers.sinumerik.mailbox.pushing import MailboxPushing
from drivers.sinumerik.mailbox.reader import MailboxReader, machine_of
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.switching import MailboxDisabling, MailboxSwitching
from drivers.sinumerik.mailbox.wire import ModbusWire
from drivers.sinumerik.reach import host_and_port, reach
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.tables import HELD_KINDS, REVERSAL
from drivers.stale_programs import NOTHING, SentPrograms, StaleProgram
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import Identity, KnownAs, MachineIdentity
from drivers.types.machine import MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import Sense
from drivers.workpiece import GrindPlan

# The controller.

CAPABILITIES = Capabilities(
    stops=False,
    tables=(*HELD_KINDS, REVERSAL),
    switched="by-itself",
    marker=True,
    consent="panel",
    cross_shown="either-way",
    together=True,
    off_anyhow=True,
)


class SinumerikModbus(SafePositionMixin, KnownAs):
    """Driver "sinumerik-modbus": settings in `drivers.sinumerik.mailbox.settings.ModbusSettings`."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        found = ModbusSettings.read(settings, name)
        self._talk = PlcConversation(ModbusWire(url, found, clock, name), found, clock, name)
        self._reader = MailboxReader(self._talk, name)
        self._pushing = MailboxPushing(talk=self._talk, reader=self._reader, settings=found, clock=clock, where=name)
        self._switching = MailboxSwitching(
            talk=self._talk, reader=self._reader, pushing=self._pushing, settings=found, clock=clock, where=name
        )
        self._disabling = MailboxDisabling(
            talk=self._talk,
            reader=self._reader,
            consent=self._pushing.consent,
            settings=found,
            clock=clock,
            where=name,
        )
        self._can = replace(CAPABILITIES, unprotected=found.unprotected(url))
        self._encoder = found.encoder
        self.book: SentPrograms | None = None

    @property
    def capabilities(self) -> Capabilities:
        """No programs; tables can be switched one by one; the PLC keeps the marker; consent is given at the panel."""
        return self._can

    async def open(self, timeout_s: float) -> Identity:
        """Connect, check map and word order, and read who the machine is.

        Raises UnsupportedDevice (E-MBX-MAGIC, E-MBX-VERSION, E-MBX-WORD-ORDER, E-MBX-SILENT), TransportError,
        ProtocolError.
        """
        self._pushing.connect_s = timeout_s
        try:
            await self._talk.begin(timeout_s)
            machine = await self.identify()
        except BaseException:
            await self._talk.close()
            raise
        return Identity("sinumerik-modbus", "SINUMERIK 840D behind a PLC mailbox", machine.serial, machine.version)

    async def close(self) -> None:
        """End our session, if the PLC still listens, and let go of the wire. Never raises."""
        await self._talk.close()

    async def identify(self) -> MachineIdentity:
        """Serial number, NCK version, axis names and unit system, read afresh."""
        async with self._talk.turn:
            return self.called(await self._reader.identity())

    async def state(self) -> MachineState:
        """Status word and every axis, read afresh; there are no part-program messages on this road."""
        async with self._talk.turn:
            return await self._reader.state()

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        """Reserved points (register 10), 1 nm or 1e-7 deg, and the value limit of this product."""
        async with self._talk.turn:
            return await self._reader.limits(axis, KINDS[kind], index)

    async def marker(self) -> Marker | None:
        """What the PLC keeps of the last push."""
        return await self._reader.marker()

    # ---- what is left of ours -------------------------------------------------------------------------

    async def left_over(self) -> StaleProgram:
        """No programs run on this road, and the PLC ends a session whose heartbeat stops: nothing is left."""
        return NOTHING

    async def withdraw(self, timeout_s: float) -> StaleProgram:
        """End our session; a table that waits for the panel is then not activated any more."""
        ours = self._talk.session
        if not ours:
            return NOTHING
        del timeout_s  # leaving is bounded by itself
        await self._talk.leave()
        if self._talk.unended:
            return StaleProgram("session", ours)
        return StaleProgram("closed", ours)

    async def clear_left_over(self, timeout_s: float) -> StaleProgram:
        """Nothing is left on this road."""
        del timeout_s
        return NOTHING

    # ---- not on this road ---------------------------------------------------------------------------

    def _no_programs(self) -> UnsupportedDevice:
        return UnsupportedDevice("E-MBX-NO-PROGRAMS", self.name)

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Not on this road. Raises UnsupportedDevice (E-MBX-NO-PROGRAMS)."""
        del plan
        raise self._no_programs()

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Not on this road. Raises UnsupportedDevice (E-MBX-NO-PROGRAMS)."""
        del after, timeout_s
        raise self._no_programs()

    async def release_stop(self, counter: int) -> None:
        """Not on this road. Raises UnsupportedDevice (E-MBX-NO-PROGRAMS)."""
        del counter
        raise self._no_programs()

    async def abort_program(self) -> None:
        """Not on this road. Raises UnsupportedDevice (E-MBX-NO-PROGRAMS)."""
        raise self._no_programs()

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Not on this road. Raises UnsupportedDevice (E-GRIND-NO-PROGRAMS)."""
        raise UnsupportedDevice("E-GRIND-NO-PROGRAMS", self.name, part=plan.part)

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Not on this road. Raises UnsupportedDevice (E-MBX-NO-PROGRAMS)."""
        del after, timeout_s
        raise self._no_programs()

    # ---- tables -------------------------------------------------------------------------------------

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        """As `saved_tables`: nobody has to do anything for it."""
        del tell
        return await self.saved_tables(question.axis, question.proof)

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """As `tables.tables_by_proof`."""
        return tables.tables_by_proof(live, proof)

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        """As `tables.table_by_proof`."""
        return tables.table_by_proof(table, sense, proof)

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """The live tables of an axis, read afresh; in a session of their own outside a push."""
        async with self._talk.turn:
            ours = self._talk.session
            await self._talk.enter()
            try:
                reading = await self._reader.tables(axis, self._encoder)
                return reading.live("LIVE", self._talk.session, tables.sense_of(proof))
            finally:
                if not ours:
                    await self._talk.leave()

    async def stage(self, batch: PushBatch) -> None:
        """Open a session, wait for its release at the panel, check, back up, set the marker.

        Raises as `Consent.enter` and `MailboxPushing.prepare`; nothing acts differently yet.
        """
        self._pushing.planned(batch)
        await self._talk.alive()
        await self._pushing.consent.enter()
        async with self._talk.turn:
            await self._pushing.prepare(batch)

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        """Disable, load, read back twice afresh: old and new. Raises as `MailboxPushing.loaded`."""
        async with self._talk.turn:
            return await self._pushing.loaded(batch, timeout_s)

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What `stage` read for this very batch. Raises DeviceRefused (E-MBX-NOT-PREPARED)."""
        return tuple(self._pushing.backup_of(order) for order in batch)

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        """Ask the PLC to activate those that passed; it waits for the panel. Raises as `Switching.release`."""
        async with self._talk.turn:
            await self._switching.release(batch, passed)

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """Table by table: true when a person confirmed once and its switches read on, false when it was left off."""
        return await self._switching.enabled(passed, timeout_s)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """Wait through NCK reset and reference run; a backlash acts already.

        Raises DeadlineExceeded (E-NC-NO-ACTIVATION).
        """
        restarting = tuple(order for order in passed if order.table.kind != "reversal")
        if restarting:
            await self._switching.activated(restarting, timeout_s)

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Switch the order's table and wait until it acts or is gone. Raises as `Switching.switch`."""
        async with self._talk.turn:
            await self._switching.switch(order, enable, timeout_s)

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        """Switches and acting value of a table, read afresh."""
        async with self._talk.turn:
            return await self._disabling.reading(order)

    async def prepare_disable(self, order: DisableOrder) -> None:
        """Wait for the release, a person's consent, and see whether command 6 would be taken now.

        Raises as `MailboxDisabling.enter` and its `check_encoder`.
        """
        await self._disabling.enter()
        async with self._talk.turn:
            await self._disabling.check(order)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Command 6, and what is read back. Raises as `MailboxDisabling.enter` and its `disable_blocks`."""
        await self._disabling.enter()
        async with self._talk.turn:
            return await self._disabling.disabled(order, timeout_s)

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state and end the session. Raises DeviceRefused (E-MBX-MARKER)."""
        async with self._talk.turn:
            await self._switching.finish(batch, state)


# The doctor: no register is written, so no axis is selected and no session opened.

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
        self._talk = PlcConversation(ModbusWire(url, found, clock, name), found, clock, name)

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
