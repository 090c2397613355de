"""An instrument behind the bridge: streams samples, reads its environment, turns a calibrator."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Mapping
from typing import Any

import numpy as np

from drivers.bridge import records
from drivers.bridge.codec import BridgeMessage, Damaged, Notification, SampleFrame
from drivers.bridge.line import BridgeLine
from drivers.bridge.records import BREAKS, BridgeSamples, CalibratorStatus, Event, Fields
from drivers.bridge.settings import BridgeSettings
from drivers.clock import Clock
from drivers.errors import DeviceRefused, NotReferenced, RemoteProtocolError, TrueflankError, catalogue
from drivers.link import Feed, Trace
from drivers.message import Message
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor, FloatArray

# Bridge samples and frames to sample blocks: order and loss checked, what follows a broken beam marked, pure.


class BridgeStream:
    """One stream from its start on.

    ``order`` names, for each channel, its column in a frame; the first sample after the start has number 0.
    """

    def __init__(self, channels: tuple[str, ...], where: str, order: tuple[int, ...] | None = None) -> None:
        self._channels = channels
        self._order = None if order in (None, tuple(range(len(channels)))) else order
        self._where = where
        self._next = 0
        self._began_s = np.nan
        self._latest_s = -np.inf
        self._said: list[Event] = []
        self._damaged = 0
        self.repeats = 0
        self.damaged_bytes = 0

    def note(self, events: tuple[Event, ...]) -> None:
        """Events that were told apart from samples: they belong to the next block."""
        self._said += events

    def spoil(self, skipped: int) -> None:
        """Bytes that could not be read: the next block tells of them."""
        self._damaged += skipped
        self.damaged_bytes += skipped

    def take(self, samples: BridgeSamples) -> SampleBlock | None:
        """The block, None for one that came twice. Raises RemoteProtocolError (E-BRIDGE-CLOCK)."""
        lost = self._lost(samples.sequence, samples.t0_s, len(samples.valid), samples.lost)
        if lost is None:
            return None
        time_s = self._times(samples.t0_s, samples.dt_s, len(samples.valid))
        values = np.column_stack([samples.values[name] for name in self._channels])
        events = (*self._told(), *samples.events)
        valid = samples.valid & ~_broken(events, time_s)
        return SampleBlock(
            channels=self._channels, time_s=time_s, values=values, valid=valid, lost=lost, events=self._messages(events)
        )

    def take_frame(self, frame: SampleFrame) -> SampleBlock | None:
        """As `take`. Raises RemoteProtocolError (E-BRIDGE-CLOCK, E-BRIDGE-FIELD: another number of channels)."""
        if frame.values.shape[1] != len(self._channels):
            wanted, got = f"{len(self._channels)}", f"{frame.values.shape[1]}"
            raise RemoteProtocolError("E-BRIDGE-FIELD", self._where, field="channels", wanted=wanted, got=got)
        lost = self._lost(frame.sequence, frame.t0_s, len(frame), frame.lost)
        if lost is None:
            return None
        time_s = self._times(frame.t0_s, frame.dt_s, len(frame))
        events = self._told()
        valid = np.full(len(frame), frame.valid)
        if events:
            valid &= ~_broken(events, time_s)
        values = frame.values if self._order is None else frame.values[:, list(self._order)]
        return SampleBlock(
            channels=self._channels, time_s=time_s, values=values, valid=valid, lost=lost, events=self._messages(events)
        )

    def _told(self) -> tuple[Event, ...]:
        said, self._said = tuple(self._said), []
        return said

    def _messages(self, events: tuple[Event, ...]) -> tuple[Message, ...]:
        said = tuple(Message.of("W-BRIDGE-EVENT", kind=event.kind, at_s=event.at_s) for event in events)
        damaged, self._damaged = self._damaged, 0
        return (Message.of("W-BRIDGE-DAMAGED", damaged=damaged), *said) if damaged else said

    def _lost(self, sequence: int, t0_s: float, count: int, lost: int) -> int | None:
        """Samples lost just before; None for what came already. A stream that begins anew starts at 0."""
        fresh = sequence == 0 and t0_s != self._began_s
        gap = 0 if fresh else sequence - self._next
        if gap < 0:
            self.repeats += 1
            return None
        self._next = sequence + count
        if fresh:
            self._began_s = t0_s
        return 0 if fresh else max(gap, lost)

    def _times(self, t0_s: float, dt_s: float, count: int) -> FloatArray:
        time_s = np.arange(count, dtype=np.float64)
        time_s *= dt_s
        time_s += t0_s
        if count and time_s[0] <= self._latest_s:
            before, now = f"{self._latest_s:.6f}", f"{time_s[0]:.6f}"
            raise RemoteProtocolError("E-BRIDGE-CLOCK", self._where, before=before, now=now)
        self._latest_s = float(time_s[-1]) if count else self._latest_s
        return time_s


def _broken(events: tuple[Event, ...], time_s: FloatArray) -> np.ndarray:
    """Samples (n,) from a break to the datum after it, or to the block's end."""
    broken = np.zeros(len(time_s), np.bool_)
    for event in events:
        if event.kind in BREAKS:
            broken |= time_s >= event.at_s
        elif event.kind == "datum":
            broken &= time_s < event.at_s
    return broken


# The instrument.

CHECK_S = 10.0


class BridgeInstrument:
    """Driver "bridge": any instrument of docs/instrument-bridge.md; a rotary calibrator turns as well."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._settings = BridgeSettings.read(settings, name)
        self._feed = Feed(name)
        self._line = BridgeLine(
            name=name, url=url, settings=self._settings, clock=clock, hear=self._hear, lost=self._lost
        )
        self._stream: BridgeStream | None = None
        self._framed = False
        self._battery_pct: float | None = None
        self._checked_at = 0.0

    @property
    def trace(self) -> Trace | None:
        """Called with every piece of bytes; set before `open`."""
        return self._line.trace

    @trace.setter
    def trace(self, trace: Trace | None) -> None:
        self._line.trace = trace

    @property
    def channels(self) -> tuple[str, ...]:
        """As the bridge names them, with units; empty before the first `open`."""
        return self._line.who.channels if self._line.who else ()

    @property
    def compensated_for(self) -> CompensatedFor:
        """As the bridge says; "nothing" before the first `open`."""
        return self._line.who.compensated_for if self._line.who else "nothing"

    @property
    def notices(self) -> tuple[str, ...]:
        """What the instrument cannot see, in the bridge's words, and a battery that runs low."""
        said = self._line.who.notices if self._line.who else ()
        low = self._battery_pct is not None and self._battery_pct < self._settings.battery_warn_pct
        return (*said, catalogue()["N-BRIDGE-BATTERY"]["what"]) if low else said

    async def open(self, timeout_s: float) -> Identity:
        """Connect and identify. Raises what `BridgeLine.open` raises."""
        await self.close()
        self._feed, self._stream, self._battery_pct = Feed(self.name), None, None
        who = await self._line.open(timeout_s)
        return Identity(
            driver="bridge",
            model=f"{who.maker} {who.model}".strip(),
            serial=who.serial,
            firmware=who.firmware,
            notes=who.notices,
        )

    def _hear(self, message: BridgeMessage) -> None:
        stream = self._stream
        if isinstance(message, SampleFrame):
            self._publish(stream.take_frame(message) if stream else None)
        elif isinstance(message, Damaged):
            self._hear_damage(message)
        elif isinstance(message, Notification) and message.method == records.SAMPLES:
            samples = BridgeSamples.read(message.params, self.channels, self.name)
            self._publish(stream.take(samples) if stream else None)
        elif isinstance(message, Notification) and message.method == records.EVENTS and stream is not None:
            stream.note(records.read_events(message.params, self.name))

    def _hear_damage(self, message: Damaged) -> None:
        """Between frames damage is passed over and counted; a line that cannot be read ends the conversation."""
        if not (message.skipped and self._framed):
            raise self._line.damaged(message)
        if self._stream is not None:
            self._stream.spoil(message.skipped)

    def _publish(self, block: SampleBlock | None) -> None:
        if block is not None:
            self._feed.publish(block)

    def _lost(self, error: TrueflankError) -> None:
        self._feed.fail(error)

    async def close(self) -> None:
        """Let go of the wire and end the stream; never raises."""
        await self._line.close()

    async def optics(self) -> Optics:
        """What is in the beam; "unknown" where the instrument cannot tell."""
        result = await self._if_it_can(records.OPTICS)
        return Optics() if result is None else records.read_optics(result, self.name)

    async def set_datum(self) -> None:
        """Count afresh after a lost beam; nothing where the bridge knows no such thing. Raises BeamObstructed."""
        await self._if_it_can(records.DATUM)

    async def ambient(self) -> Ambient:
        """Environment readings; empty where the instrument has no sensors."""
        result = await self._if_it_can(records.ENVIRONMENT)
        return Ambient() if result is None else records.read_environment(result, self.name)

    async def _if_it_can(self, method: str) -> Any:
        try:
            return await self._line.call(method)
        except DeviceRefused as error:
            if error.code == "E-BRIDGE-UNSUPPORTED":
                return None
            raise

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Start the stream and give samples from now on; stop it when the caller leaves.

        Raises DeviceRefused (E-BRIDGE-UNSUPPORTED, E-BRIDGE-BATTERY), NotReferenced at the start; ends with
        TransportError, RemoteProtocolError, NotReferenced or DeviceRefused (E-BRIDGE-EMPTY: the battery).
        """
        await self._check_ready()
        # What still comes of an older stream until the answer is here belongs to nobody.
        self._stream = None
        await self._start()
        order = self._line.who.order if self._line.who else None
        stream = self._stream = BridgeStream(self.channels, self.name, order)
        try:
            async with contextlib.aclosing(self._feed.follow(self._clock, self._settings.stale_s)) as feed:
                async for block in feed:
                    yield block
                    await self._check_fit(block)
        finally:
            if self._stream is stream:
                await self._stop()

    async def _start(self) -> None:
        """Ask for frames where bridge and site file allow them; older bridges know no parameters here."""
        framings = self._line.who.framings if self._line.who else ()
        self._framed = False
        if records.BINARY in framings and self._settings.framing != records.JSON:
            answer = Fields(await self._line.call(records.START, {"framing": records.BINARY}), self.name)
            self._framed = answer.text("framing", records.JSON) == records.BINARY
        elif self._settings.framing == records.BINARY:
            said = Message.of("W-BRIDGE-NO-FRAMES")
            raise DeviceRefused("E-BRIDGE-UNSUPPORTED", self.name, method=records.START, said=said)
        else:
            await self._line.call(records.START)

    async def _stop(self) -> None:
        self._stream = None
        if self._line.works:
            with contextlib.suppress(TrueflankError):
                await self._line.call(records.STOP)

    async def _check_ready(self) -> None:
        if self._line.who is not None and not self._line.who.sample_rate_hz:
            said = Message.of("W-BRIDGE-NO-STREAM")
            raise DeviceRefused("E-BRIDGE-UNSUPPORTED", self.name, method=records.START, said=said)
        await self._check_calibrator("E-BRIDGE-BATTERY", self._settings.battery_refuse_pct)

    async def _check_fit(self, block: SampleBlock) -> None:
        """A calibrator that lost its reference or runs empty ends the stream before its readings go wrong."""
        kinds = {event.fields.get("kind") for event in block.events}
        if "reference_lost" in kinds:
            raise NotReferenced("E-BRIDGE-REFERENCE", self.name, said=Message.of("W-BRIDGE-REF-LOST"))
        if "battery_low" in kinds or self._clock.now() >= self._checked_at + CHECK_S:
            await self._check_calibrator("E-BRIDGE-EMPTY", self._settings.battery_stop_pct)

    async def _check_calibrator(self, code: str, least_pct: float) -> None:
        self._checked_at = self._clock.now()
        if self._line.who is None or self._line.who.kind != "rotary_calibrator":
            return
        status = CalibratorStatus.read(await self._line.call(records.STATUS), self.name)
        self._battery_pct = status.battery_pct
        if not status.referenced:
            raise NotReferenced("E-BRIDGE-REFERENCE", self.name, said=Message.of("W-BRIDGE-REF-FALSE"))
        if status.battery_pct is not None and status.battery_pct < least_pct:
            raise DeviceRefused(code, self.name, said=f"{status.battery_pct:g} % left")

    async def hold(self) -> None:
        """Stop following: the device keeps its own angle while the axis moves."""
        await self._calibrator(records.HOLD)

    async def track(self) -> None:
        """Follow the axis again by turning against it."""
        await self._calibrator(records.TRACK)

    async def turn(self, by_deg: float) -> None:
        """Turn the device alone by this angle of its own encoder, and hold."""
        await self._calibrator(records.TURN, {"by_deg": by_deg})

    async def _calibrator(self, method: str, params: Mapping[str, Any] | None = None) -> None:
        if self._line.who is not None and self._line.who.kind != "rotary_calibrator":
            said = Message.of("W-BRIDGE-IS-KIND", kind=self._line.who.kind)
            raise DeviceRefused("E-BRIDGE-UNSUPPORTED", self.name, method=method, said=said)
        await self._line.call(method, params, timeout_s=self._settings.turn_timeout_s)
