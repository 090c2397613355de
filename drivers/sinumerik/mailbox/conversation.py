"""The conversation with the PLC: heartbeat, session, checks, commands followed to their end, release at the panel.

One command is open at a time. It is written once, never repeated, and followed in the status registers until the PLC
reports its number as done or refused; no progress for `STALLED_S` ends the wait. Register 15 changes about once a
second while a session is open, so that the PLC can end a session whose PC is gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import Sequence
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, RemoteProtocolError, TrueflankError
from drivers.sinumerik.mailbox.codec import frames, registers
from drivers.sinumerik.mailbox.codec.frames import (
    MailboxOrder,
    Picture,
    Selection,
    Status,
    check_map,
    command_refusal,
    encode_command,
    next_number,
)
from drivers.sinumerik.mailbox.codec.registers import (
    ADDRESS,
    DATA_SPAN,
    LAST_NUMBER,
    PICTURE_SPAN,
    READ_BACK_SPAN,
    STATUS_SPAN,
    Command,
    Kind,
    StatusBit,
)
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import ModbusWire

# Heartbeat.

PERIOD_S = 1.0


class Heartbeat:
    """One task that ends by itself: an exchange that is cut short would break the wire."""

    def __init__(self, wire: ModbusWire, clock: Clock, where: str) -> None:
        self._wire = wire
        self._clock = clock
        self._where = where
        self._task: asyncio.Task[None] | None = None
        self._stop = asyncio.Event()

    def start(self) -> None:
        """Beat from now on, if it does not already."""
        if self._task is None or self._task.done():
            self._stop = asyncio.Event()
            loop = asyncio.get_running_loop()
            self._task = loop.create_task(self._run(self._stop), name=f"heartbeat to {self._where}")

    async def stop(self) -> None:
        """Beat no more; returns when the last beat has been answered or has failed."""
        task, self._task = self._task, None
        if task is not None:
            self._stop.set()
            await asyncio.gather(task, return_exceptions=True)

    async def _run(self, stop: asyncio.Event) -> None:
        """A wire that broke ends it, and the next command says why."""
        beat = 0
        with contextlib.suppress(TrueflankError):
            while not stop.is_set():
                beat = beat % LAST_NUMBER + 1
                try:
                    await self._wire.write_one(ADDRESS["PC_HEARTBEAT"], beat)
                except DeadlineExceeded:
                    if not self._wire.sound:
                        return
                    continue  # its turn did not come: another exchange took all the time
                with contextlib.suppress(DeadlineExceeded):
                    async with self._clock.deadline(PERIOD_S, self._where):
                        await stop.wait()


# Session and commands.

STALLED_S = 3.0
FRESH_S = 1.0
LAPSE_S = 6.0
LEAVE_S = 3.0
AT_ONCE = 2
_ALONE = (Command.OPEN, Command.SELECT)


class PlcConversation:
    """One PLC. After any failed exchange the wire is broken and every call says so until `begin` or `renew`."""

    def __init__(self, wire: ModbusWire, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._wire = wire
        self._settings = settings
        self._clock = clock
        self._where = where
        self._order = settings.order
        self._last: Status | None = None
        self._heard: int | None = None
        self._heard_at = 0.0
        self._moved = False
        self._looked_at = 0.0
        self._session = 0
        self._left = 0  # a session that we could not end, because the wire was broken
        self._heartbeat = Heartbeat(wire, clock, where)
        self._header: tuple[int, ...] = ()
        # Several tasks of ours may ask at once: who selects or commands holds the turn until its answer is read.
        self.turn = asyncio.Lock()
        self.waiting = False

    @property
    def session(self) -> int:
        """The number of our open session, 0 for none."""
        return self._session

    @property
    def unended(self) -> int:
        """The number of a session that we could not end, because the wire was broken; 0 for none."""
        return self._left

    @property
    def reserved(self) -> int:
        """Reserved points of the table selected last (register 10, as its command was reported done)."""
        return self._last.reserved if self._last is not None else 0

    # ---- connection ---------------------------------------------------------------------------------

    async def begin(self, timeout_s: float) -> Status:
        """Connect and check magic, version and word order before anything else.

        Raises UnsupportedDevice (E-MBX-MAGIC, E-MBX-VERSION, E-MBX-WORD-ORDER), and what the wire raises.
        """
        await self._heartbeat.stop()
        await self._wire.open(timeout_s)
        status = await self.status()
        if self._session and status.session == self._session:
            self._heartbeat.start()
        else:
            self._session = 0
        return status

    async def renew(self, timeout_s: float) -> None:
        """Close the connection and go on in a new one, in the same session. Raises as `begin`, E-MBX-SESSION."""
        mine = self._session
        status = await self.begin(timeout_s)
        if self._session != mine:
            raise DeviceRefused("E-MBX-SESSION", self._where, session=status.session, mine=mine)

    async def close(self) -> None:
        """Leave the session if the wire still works, and let go. Never raises."""
        await self.leave()
        await self._wire.close()

    async def leave(self) -> None:
        """End the session as far as that is possible; never raises what the wire or the PLC say."""
        if self._session:
            self._left = self._session
            with contextlib.suppress(TrueflankError):
                async with self._clock.deadline(LEAVE_S, self._where):
                    await self.do(MailboxOrder(Command.CLOSE))
                    self._left = 0
        self._session = 0
        await self._heartbeat.stop()

    # ---- reading ------------------------------------------------------------------------------------

    async def status(self) -> Status:
        """Registers 0-14, checked. Raises as `begin`, and E-MBX-STALLED in a session whose PLC has stopped."""
        registers = await self._wire.read(*STATUS_SPAN)
        check_map(registers, self._order, self._where)
        status = frames.decode_status(registers, self._order)
        now = self._clock.now()
        if status.heartbeat != self._heard:
            self._moved = self._heard is not None
            self._heard, self._heard_at = status.heartbeat, now
        elif self._session and now - self._heard_at > STALLED_S:
            raise DeviceRefused("E-MBX-STALLED", self._where, seconds=STALLED_S)
        self._last, self._looked_at = status, now
        return status

    async def recent(self) -> Status:
        """The status, a second old at most."""
        last = self._last
        return last if last is not None and self._clock.now() - self._looked_at <= FRESH_S else await self.status()

    async def alive(self) -> None:
        """Return once the PLC's heartbeat has been seen to move. Raises DeviceRefused (E-MBX-STALLED)."""
        await self.status()
        end = self._clock.now() + STALLED_S
        while not self._moved or self._clock.now() - self._heard_at > STALLED_S:
            await self.status()
            if self._clock.now() >= end:
                raise DeviceRefused("E-MBX-STALLED", self._where, seconds=STALLED_S)
            await self._clock.sleep(self._settings.poll_s)

    async def picture(self) -> Picture:
        """Registers 302-377. Raises RemoteProtocolError (E-MBX-REGISTER)."""
        return frames.decode_picture(await self._wire.read(*PICTURE_SPAN), self._order, self._where)

    async def select(self, order: MailboxOrder) -> Picture:
        """Select the table that ``order`` names and return its picture, which must speak of it.

        Raises DeviceRefused (E-MBX-SELECTION: another PC selects too).
        """
        await self.do(order.as_command(Command.SELECT))
        return await self.picture_for(order)

    async def picture_for(self, order: MailboxOrder) -> Picture:
        """The picture, if it still speaks of what ``order`` names. Raises as `select`."""
        picture = await self.picture()
        axis = order.output_axis if order.kind is Kind.CEC else order.index
        wanted = Selection(order.kind, order.index, order.encoder, axis)
        if picture.selection != wanted:
            raise DeviceRefused(
                "E-MBX-SELECTION", self._where, wanted=_selection_text(wanted), found=_selection_text(picture.selection)
            )
        return picture

    async def points(self, order: MailboxOrder, first: int, count: int) -> tuple[int, ...]:
        """``count`` points from ``first`` as they stand in the control. Raises RemoteProtocolError (E-MBX-READ-CRC)."""
        await self.do(order.as_command(Command.READ_BACK, first, count))
        registers = await self._wire.read(*READ_BACK_SPAN)
        values = frames.decode_read_back(registers, self._header, count, self._order)
        if values is None:
            raise RemoteProtocolError("E-MBX-READ-CRC", self._where, first=first, count=count)
        return values

    # ---- commands -----------------------------------------------------------------------------------

    async def do(self, order: MailboxOrder, data: Sequence[int] = (), whole: Sequence[int] = ()) -> Status:
        """Send a command once and follow it until it is done. Raises what `start` and `end_blocks` raise."""
        await self.start(order, data, whole)
        return await self.ended(order, self._settings.command_s)

    async def start(self, order: MailboxOrder, data: Sequence[int] = (), whole: Sequence[int] = ()) -> None:
        """Write a command: data first, then the header with the next number. Never repeated.

        Raises DeviceRefused (E-MBX-BUSY, E-MBX-SESSION) with nothing written.
        """
        before = self._last
        if before is None or not self._session:
            before = await self.status()
        if order.command not in _ALONE:
            self._check_session(before)
        if before.has(StatusBit.BUSY) and order.command not in (Command.ABORT, Command.CLOSE):
            before = await self._idle()
        frame = encode_command(order, next_number(before.number), word_order=self._order, data=data, whole=whole)
        if frame.data:
            await self._wire.write(DATA_SPAN[0], frame.data)
        self._header = frame.header
        self.waiting = order.command is Command.ACTIVATE
        await self._wire.write(ADDRESS["COMMAND"], frame.header)

    async def _idle(self) -> Status:
        """The status once the PLC has ended what somebody before us asked for, a while waited for at most."""
        end = self._clock.now() + LAPSE_S
        while (status := await self.status()).has(StatusBit.BUSY):
            if self._clock.now() >= end:
                raise DeviceRefused("E-MBX-BUSY", self._where, number=status.number)
            await self._clock.sleep(self._settings.poll_s)
        return status

    async def ended(self, order: MailboxOrder, limit_s: float, *, or_waiting: bool = False) -> Status:
        """Poll until the last command is done, or with ``or_waiting`` waits for the panel.

        Raises the refusal of its error code, DeadlineExceeded (E-MBX-NO-ANSWER), DeviceRefused (E-MBX-FOREIGN,
        E-MBX-RESTARTED, E-MBX-SESSION, E-MBX-STALLED).
        """
        start, looks = self._clock.now(), 0
        before, mine = self._last.number if self._last else 0, self._header[1]
        while True:
            status = await self.status()
            self._check_ours(status, before)
            if status.number == mine:
                self.waiting = status.has(StatusBit.BUSY)
                if status.has(StatusBit.ERROR):
                    raise command_refusal(status, order, self._where)
                self._check_session(status, order.command)
                waits = or_waiting and status.has(StatusBit.BUSY, StatusBit.AWAITS_CONFIRM)
                if status.has(StatusBit.DONE) or waits:
                    return status
            waited_s = self._clock.now() - start
            if waited_s >= limit_s:
                raise DeadlineExceeded("E-MBX-NO-ANSWER", self._where, command=order.command.name, limit_s=limit_s)
            # A few looks at once, counted: a clock may stand still while anybody can run. Then ever slower, so that
            # little more is waited than the PLC took.
            looks += 1
            slower_s = min(max(waited_s / 3.0, self._settings.fast_poll_s), self._settings.poll_s)
            await self._clock.sleep(slower_s if looks > AT_ONCE else 0.0)

    def _check_ours(self, status: Status, before: int) -> None:
        mine, crc = self._header[1], registers.unpack_udint(self._header[18:20], self._order)
        if status.number == 0 and before:
            raise DeviceRefused("E-MBX-RESTARTED", self._where)
        stranger = status.number not in (before, mine) or (status.number == mine and status.crc != crc)
        if stranger:
            raise DeviceRefused("E-MBX-FOREIGN", self._where, number=status.number, mine=mine)

    def _check_session(self, status: Status, command: Command | None = None) -> None:
        if command in (Command.OPEN, Command.CLOSE):
            return
        if self._session and status.session != self._session:
            raise DeviceRefused("E-MBX-SESSION", self._where, session=status.session, mine=self._session)

    # ---- session ------------------------------------------------------------------------------------

    async def enter(self) -> None:
        """Open a session, or go on in ours. One that a stopped PC left is waited for until it lapses.

        Raises DeviceRefused (E-MBX-TAKEN) when another PC holds the mailbox.
        """
        status = await self.status()
        if self._session and status.session == self._session:
            return
        if status.session and status.session == self._left:
            self._session = self._left
            await self.leave()
            status = await self.status()
        self._session, end = 0, self._clock.now() + LAPSE_S
        while status.session and self._clock.now() < end:
            await self._clock.sleep(self._settings.poll_s)
            status = await self.status()
        if status.session:
            raise DeviceRefused("E-MBX-TAKEN", self._where, detail=status.session)
        number = secrets.randbelow(LAST_NUMBER) + 1
        self._session = number
        try:
            await self.do(MailboxOrder(Command.OPEN, index=number))
        except BaseException:
            self._session, self._left = 0, number
            raise
        self._heartbeat.start()


def _selection_text(selection: Selection) -> str:
    kind = selection.kind.name
    return f"{kind} {selection.index} encoder {selection.encoder} axis {selection.axis}"


# The release at the panel counts only if a person gave it after our session began.


class PanelRelease:
    """Enters a session and waits for its release; knows whether one was given in the session that is open."""

    def __init__(self, talk: PlcConversation, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._talk = talk
        self._settings = settings
        self._clock = clock
        self._where = where
        self._given_in = 0

    @property
    def given(self) -> bool:
        """Whether a release was seen in the session that is open, however long ago."""
        return bool(self._talk.session) and self._given_in == self._talk.session

    def permits_off(self, status: Status) -> bool:
        """Whether command 6 would be taken: given in this session and not taken back, however long ago."""
        return status.has(StatusBit.RELEASED) or (self.given and status.has(StatusBit.RELEASE_STALE))

    async def enter(self) -> None:
        """A session of ours in which a release counts; a person has `ModbusSettings.release_s` for it.

        Raises as `Talk.enter`, DeviceRefused (E-MBX-NO-RELEASE, E-MBX-RELEASE-STALE); a session that was opened for it
        is closed then.
        """
        ours = self._talk.session
        await self._talk.enter()
        try:
            await self._wait()
        except BaseException:
            if not ours:
                await self._talk.leave()
            raise

    async def _wait(self) -> None:
        end = self._clock.now() + self._settings.release_s
        while not (status := await self._talk.status()).has(StatusBit.RELEASED):
            if self._clock.now() >= end:
                told: dict[str, Any] = {"limit_s": round(self._settings.release_s)}
                stale = status.has(StatusBit.RELEASE_STALE)
                raise DeviceRefused("E-MBX-RELEASE-STALE" if stale else "E-MBX-NO-RELEASE", self._where, **told)
            await self._clock.sleep(self._settings.poll_s)
        self._given_in = self._talk.session
