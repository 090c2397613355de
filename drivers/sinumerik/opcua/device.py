"""The SINUMERIK 840D behind its OPC UA server, as a Controller: programs sent, followed, and answered.

The operator's NC START starts every program; nothing here can. Reads may be repeated by the caller, a write
never: after DeadlineExceeded or LinkBroken what the control did is unknown, `open` makes a fresh session.
Compensation values come in um or arcsec, positions in mm or deg.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets as random_source
from collections.abc import Callable, Mapping
from typing import Any, Literal

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TrueflankError, UnsupportedDevice
from drivers.limits import VALUE_RESOLUTION, largest_value
from drivers.programs import NOBODY, Origin, ProgramText
from drivers.sinumerik.ncprogram import measuring as measuring_program
from drivers.sinumerik.ncprogram.backup import Memory, Saving
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.ncprogram.measuring import Setting
from drivers.sinumerik.ncprogram.words import Phase, Word, program_path
from drivers.sinumerik.opcua import encoders
from drivers.sinumerik.opcua.activation import activation
from drivers.sinumerik.opcua.dialogue import Dialogue, Glance, file_refused
from drivers.sinumerik.opcua.disabling import Disabling
from drivers.sinumerik.opcua.grinding import PartGrinding
from drivers.sinumerik.opcua.leaving import Leaver, Leaving
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.pushing import Pushing, live_tables
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.settings import UaSettings, secrets_of
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.sinumerik.tablefile.held import HELD
from drivers.types import (
    Capabilities,
    ChannelStatus,
    DisableOrder,
    Identity,
    LiveSet,
    MachineIdentity,
    MachineState,
    Marker,
    PushOrder,
    StopPlan,
    StopReached,
    SwitchReading,
    TableLimits,
)
from drivers.units import deviation_scale
from drivers.workpiece import GrindPlan

GIVE_BACK_S = 3.0
CAPABILITIES = Capabilities(stops=True, tables=HELD, switched="at-stop", marker=True, consent="start", grinding=True)
QUIET_PART, QUIET_S = 0.6, 2.0
_SAVED = (Phase.MEASURING, Phase.FINISHED, Phase.LEFT)
_OVER = (Phase.FINISHED, Phase.LEFT)


class SinumerikOpcUa(Leaver):
    """Driver "sinumerik-opcua": settings in `drivers.sinumerik.opcua.settings.UaSettings`."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._settings = UaSettings.read(settings, name)
        self._session = UaSession(url, clock, name)
        self._reader = MachineReader(self._session, self._settings, name)
        self._transfer = Transfer(self._session, self._settings.channel, name)
        self._dialogue = Dialogue(self._session, self._reader, self._settings, clock=clock, where=name)
        parts = (self._dialogue, self._reader, self._transfer)
        self._pushing = Pushing(*parts, settings=self._settings, clock=clock, where=name)
        self._disabling = Disabling(*parts, pushing=self._pushing, where=name)
        self._grinding = PartGrinding(*parts, settings=self._settings, clock=clock, where=name)
        self._leaving = Leaving(
            *parts, channel=self._settings.channel, clock=clock, where=name, reopen=self._open_again
        )
        self._configuration = Configuration((), (), ())
        self._origin = NOBODY
        self._plan: StopPlan | None = None
        self._token, self._memory = 0, Memory(0)
        self._saved = self._ended = False
        self._moving_since: float | None = None
        self._move_s = 0.0

    # ---- device -------------------------------------------------------------------------------------

    async def open(self, timeout_s: float) -> Identity:
        """Log in and read who the machine is; the limit then holds for every later request too.

        Raises what `UaSession.open` raises, ConfigError (E-UA-SECRET), UnsupportedDevice (E-UA-ABSENT).
        """
        self._reader.timeout_s = self._transfer.timeout_s = timeout_s
        secrets = await asyncio.to_thread(secrets_of, self._settings, self.name)
        await self._session.open(secrets, timeout_s)
        try:
            machine = await self.identify()
        except BaseException:
            await self._session.close()
            raise
        return Identity("sinumerik-opcua", "SINUMERIK 840D", machine.serial, machine.version)

    def attend(self, origin: Origin, keep: Callable[[ProgramText], None]) -> None:
        """From now on programs carry ``origin`` in their head; ``keep`` is called with each before it is sent."""
        self._origin = self._grinding.origin = origin
        self._transfer.keep = keep

    async def close(self) -> None:
        """Give the R parameters back, as far as no program still needs them, and log out. Never raises."""
        if self._session.is_open:
            with contextlib.suppress(TrueflankError):
                async with self._clock.deadline(GIVE_BACK_S, self.name):
                    await self._dialogue.give_back()
        await self._session.close()

    async def _open_again(self) -> None:
        await self.open(self._reader.timeout_s)

    async def identify(self) -> MachineIdentity:
        """Serial number, NCK version, axis names and unit system, read afresh."""
        self._configuration = await self._reader.configuration()
        return await self._reader.identity(self._configuration.names)

    async def state(self) -> MachineState:
        """Everything in one request. Raises TransportError (E-UA-NCK-DOWN) while the NCK restarts."""
        return await self._reader.state(self._configuration)

    @property
    def capabilities(self) -> Capabilities:
        """Programs of ours run; tables are switched at a stop of theirs; the marker stands in four R parameters."""
        return CAPABILITIES

    async def table_limits(self, axis: str, kind: Literal["axis", "cross"] = "axis", index: int = 0) -> TableLimits:
        """MD38000 of an encoder or MD18342 of a table, six decimals of a mm or degree, our value limit, MD32720."""
        memory = await self._reader.memory(self._configuration, axis, index if kind == "axis" else 0)
        unit = self._configuration.units[axis]
        if kind == "axis":
            return TableLimits(memory.eec_points, VALUE_RESOLUTION, largest_value(unit))
        reserved = memory.cec_points[index] if 0 <= index < len(memory.cec_points) else 0
        largest = await self._reader.figure(f"$MA_CEC_MAX_SUM[{axis}]", self._configuration)
        return TableLimits(reserved, VALUE_RESOLUTION, largest_value(unit), largest)

    async def marker(self) -> Marker | None:
        """The last push as R parameters remember it, whoever made it."""
        return await self._pushing.marker()

    # ---- measuring ----------------------------------------------------------------------------------

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Send, read back and select the program of a plan.

        Raises DeviceRefused (E-NC-NOT-RESET and other refusals), and as `legal`, before anything was written.
        """
        setting = await self._setting(plan.axis, plan.compensated_axis, plan.encoder, rotary=plan.rotary)
        await self._check_encoder(plan.compensated_axis, plan.encoder, said=plan.encoder_said)
        token = random_source.randbelow(899_999) + 100_000
        path = program_path("MEAS", plan.compensated_axis)
        passed = legal(path, measuring_program.measuring(plan, token, setting), self._configuration.names)
        await self._dialogue.begin(setting.axis_number, token, path)
        self._plan, self._token, self._saved, self._ended = plan, token, False, False
        self._memory, self._grinding.plan = setting.memory, None
        self._moving_since, self._move_s = None, 0.0
        await self._transfer.send(passed)
        await self._transfer.select(path)

    async def _setting(self, axis: str, compensated: str, encoder: int, *, rotary: bool) -> Setting:
        """What the programs must know: ``axis`` is the one that moves."""
        configuration = self._configuration
        number = configuration.number(axis, self.name)
        return Setting(
            words=self._settings.words,
            memory=await self._reader.memory(configuration, compensated, encoder),
            modulo=configuration.is_modulo(axis, rotary=rotary),
            axis_number=number,
            approach_feed=self._settings.approach_feed,
            wait_limit_s=self._settings.wait_limit_s,
            origin=self._origin,
        )

    async def _check_encoder(self, axis: str, encoder: int, *, said: bool) -> None:
        """The site file's measuring system must be the one that acts. Raises UnsupportedDevice (E-NC-ENCODER...)."""
        found = await self._reader.encoders(self._configuration, axis)
        encoders.check(found, axis, encoder, self.name, said=said)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a counter above ``after`` with the axis in position; None when the program has ended.

        Raises DeadlineExceeded (E-NC-NO-STOP), DeviceRefused (E-NC-ALARM, E-NC-FILE), and what the wire raises.
        """
        end = self._clock.now() + timeout_s
        before: Glance | None = None
        looks = 0
        if self._moving_since is not None:
            await self._dialogue.wait()
        while not self._ended:
            seen = await self._dialogue.look()
            looks += 1
            await self._dialogue.check_alarms(seen)
            if seen.word(Word.TRANSACTION) == self._token:
                self._note_progress(seen)
                if before is not None and before.words == seen.words and self._is_stop(seen, after):
                    self._time_move(at_once=looks == 2)
                    return self._stop(seen)
                self._ended = self._is_over(before, seen)
                fresh = self._is_stop(seen, after) and not (before and before.words == seen.words)
                before = seen
                if fresh:
                    continue  # look again at once: the words of a stop must be seen twice alike
            if self._clock.now() >= end and not self._ended:
                raise DeadlineExceeded("E-NC-NO-STOP", self.name, after=after, timeout_s=timeout_s)
            await self._dialogue.wait()
        return None

    def _note_progress(self, seen: Glance) -> None:
        if seen.phase == Phase.FILE_FAILED:
            raise file_refused(seen, self.name, self._plan.compensated_axis if self._plan else "")
        self._saved = self._saved or seen.phase in _SAVED

    @staticmethod
    def _is_stop(seen: Glance, after: int) -> bool:
        waiting = seen.channel is ChannelStatus.ACTIVE and seen.word(Word.COUNTER) > after
        return waiting and seen.in_position and seen.phase == Phase.MEASURING

    @staticmethod
    def _is_over(before: Glance | None, seen: Glance) -> bool:
        """By its own word, or because the channel is in reset at two looks after the program had begun."""
        if seen.channel is not ChannelStatus.RESET:
            return False
        return seen.phase in _OVER or (before is not None and before.channel is ChannelStatus.RESET)

    def _stop(self, seen: Glance) -> StopReached:
        compensated = self._plan.compensated_axis if self._plan else ""
        scale = deviation_scale(self._configuration.units.get(compensated, "mm"))
        return StopReached(
            counter=round(seen.word(Word.COUNTER)),
            repetition=round(seen.word(Word.REPETITION)),
            label=round(seen.word(Word.LABEL)),
            approach=1 if seen.word(Word.APPROACH) > 0 else -1,
            target=seen.word(Word.TARGET),
            encoder_compensation=seen.word(Word.ENCODER_COMPENSATION) * scale,
            cross_compensation=seen.word(Word.CROSS_COMPENSATION) * scale,
        )

    async def release_stop(self, counter: int) -> None:
        """Echo the counter. Never retried."""
        await self._dialogue.write({Word.ECHO: float(counter)})
        self._moving_since = self._clock.now()
        self._dialogue.pace.again(min(QUIET_PART * self._move_s, QUIET_S))

    def _time_move(self, *, at_once: bool) -> None:
        """Remember how long the move took: the next stop is not expected much earlier.

        One that stood there at the first look may have stood there for long: the next is looked for earlier.
        """
        if self._moving_since is not None:
            took_s = self._clock.now() - self._moving_since
            self._move_s, self._moving_since = (0.5 * took_s if at_once else took_s), None

    async def abort_program(self) -> None:
        """Set the abort word: a program of ours that waits, now or at its start, leaves to its end.

        Raises DeviceRefused (E-NC-ANOTHER) with nothing written when another gateway's program stands there.
        """
        await self._dialogue.check_own()
        await self._dialogue.write({Word.ABORT: 1.0})
        self._dialogue.pace.again()

    async def saved_tables(self, axis: str) -> LiveSet:
        """The live tables the last program wrote before moving. Raises DeviceRefused (E-NC-NOT-SAVED, E-UA-FILE...)."""
        plan = self._plan
        if self._grinding.plan is not None:
            return await self._grinding.saved_tables(axis, self._configuration)
        if plan is not None and plan.compensated_axis == axis and plan.save_tables and not self._saved:
            seen = await self._dialogue.look()
            if seen.word(Word.TRANSACTION) == self._token:
                self._note_progress(seen)
        if plan is None or plan.compensated_axis != axis or not self._saved or not plan.save_tables:
            raise DeviceRefused("E-NC-NOT-SAVED", self.name, axis=axis)
        saving = Saving(section="LIVE", number=self._token, axis=axis, encoder=plan.encoder, memory=self._memory)
        return await live_tables(self._transfer, saving, self._configuration)

    # ---- the test part ------------------------------------------------------------------------------

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Place the set-up values, send, read back and select the program. Raises as its `prepare`."""
        self._plan, self._saved = None, False
        return await self._grinding.prepare(plan, self._configuration)

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Spaces done so far, None when the program has ended. Raises as `PartGrinding.ground`."""
        return await self._grinding.ground(after, timeout_s)

    # ---- pushing ------------------------------------------------------------------------------------

    async def stage(self, order: PushOrder) -> None:
        """Send, read back and select the two-half measuring_program. Raises as `Pushing.prepare`."""
        table = order.table
        encoder = order.saved_encoder
        setting = await self._setting(table.input_axis, table.output_axis, encoder, rotary=order.rotary)
        if order.purpose != "restore":
            await self._check_encoder(table.output_axis, encoder, said=order.encoder_said)
        self._plan, self._saved, self._grinding.plan = None, False, None
        await self._pushing.prepare(order, setting)

    async def read_back(self, order: PushOrder, timeout_s: float) -> tuple[LiveSet, LiveSet]:
        """(Back-up of the old, read-back of the new) at the end of the first half. Raises as `Pushing.loaded`."""
        return await self._pushing.loaded(order, timeout_s, self._configuration)

    async def backup_of(self, order: PushOrder) -> LiveSet:
        """What stood before the order, from the file that its own program wrote. Raises as `Pushing.backup`."""
        return await self._pushing.backup(order, self._configuration)

    async def activate(self, order: PushOrder) -> None:
        """Set the release word to the transaction number; never retried. Two programs: select the second."""
        await self._pushing.release(order)

    async def confirm(self, order: PushOrder, timeout_s: float) -> bool:
        """True when the second half switched the table on, false when it, or a reset, left it off."""
        return await self._pushing.enabled(order, timeout_s, self._configuration)

    async def restarted(self, order: PushOrder, timeout_s: float) -> None:
        """Wait through NCK reset and reference run. Raises DeadlineExceeded (E-NC-NO-ACTIVATION)."""
        look_s = 0.4 * self._settings.poll_s
        axis, shown = order.table.output_axis, order.enable
        await activation(
            self._dialogue, self._clock, axis=axis, timeout_s=timeout_s, look_s=look_s, where=self.name, shown=shown
        )

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Not on this road: stops switch. Raises UnsupportedDevice (E-NC-NO-SWITCHING)."""
        raise UnsupportedDevice(
            "E-NC-NO-SWITCHING", self.name, table=order.table.name, enable=enable, timeout_s=timeout_s
        )

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        """Switches, as far as this user may read them, and the acting value."""
        return await self._disabling.reading(order, self._configuration)

    async def prepare_disable(self, order: DisableOrder) -> None:
        """Send, read back and select the program that switches off. Raises as `Disabling.prepare`."""
        encoder = order.index if order.kind == "axis" else 0
        setting = await self._setting(order.axis, order.axis, encoder, rotary=False)
        self._plan, self._saved, self._grinding.plan = None, False, None
        await self._disabling.prepare(order, setting)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Wait for that program's end and read back. Raises as `Disabling.disabled`."""
        return await self._disabling.disabled(order, timeout_s, self._configuration)

    async def finish_push(self, order: PushOrder, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state. Never retried."""
        await self._pushing.mark(order, state)
