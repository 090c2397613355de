"""The SINUMERIK 840D behind its OPC UA server, as a Controller: programs sent, followed, and answered.

The operator's NC START starts every program; nothing here can. Reads may be repeated by the caller, a write never:
after DeadlineExceeded or LinkBroken what the control did is unknown, and `open` makes a fresh session. Compensation
values come in um or arcsec, positions in mm or deg.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, Protocol

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TrueflankError, UnsupportedDevice
from drivers.limits import VALUE_RESOLUTION, largest_value
from drivers.ports.devices import Tell
from drivers.programs import Origin, ProgramText, SelfTest, SelfTested, reading_plan
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.selftest import LOOPS
from drivers.sinumerik.ncprogram.words import Word
from drivers.sinumerik.opcua.grinding import HeldNumbers, PartGrinding
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.measuring import Measuring, StopPlanMixin
from drivers.sinumerik.opcua.program_dialogue import ProgramDialogue, Transfer
from drivers.sinumerik.opcua.pushing import Disabling, Pushing, SelfTesting
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import read_secrets, read_writing_secrets
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.stale_programs import CleanupMixin, ProgramWithdrawal
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.tables import HELD_KINDS, REVERSAL
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import Identity, KnownAs, MachineIdentity
from drivers.types.machine import MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import Sense
from drivers.workpiece import GrindPlan

# Live tables of axes where only a program can save them: it moves nothing.


class StopRunner(Protocol):
    """The part of a controller that reading needs."""

    name: str
    goes_on: bool

    async def prepare_reading(self, plans: Sequence[StopPlan]) -> None:
        """As `Controller.prepare_stops`, of plans without any stop: one program for all of them."""
        ...

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """As `Controller.wait_stop`."""
        ...

    async def abort_program(self) -> None:
        """As `Controller.abort_program`."""
        ...

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """As `Controller.saved_tables`."""
        ...


async def read_live_tables(device: StopRunner, questions: Sequence[TableQuestion], tell: Tell) -> tuple[LiveSet, ...]:
    """Select one program for all axes, let a person start it, and read what it saved; one that waits is asked to end.

    One that waits for these very plans goes on with them, and nobody needs to start anything.
    Raises DeviceRefused (E-NC-READ-STOP) for a program that is not this one, (E-NC-NOT-SAVED) for one that ended
    early, and what the calls raise.
    """
    plans = tuple(dict.fromkeys(reading_plan(question) for question in questions))
    names = ", ".join(dict.fromkeys(question.axis for question in questions))
    await device.prepare_reading(plans)
    if not device.goes_on:
        tell("P-NC-READ", axis=names)
    try:
        reached = await device.wait_stop(0, max(question.start_s for question in questions))
        if reached is not None:
            told = f"stop {reached.counter} at {reached.target}"
            raise DeviceRefused("E-NC-READ-STOP", device.name, axis=names, found=told)
    except (TrueflankError, asyncio.CancelledError):
        with contextlib.suppress(TrueflankError):
            await device.abort_program()
        raise
    return tuple([await device.saved_tables(question.axis, question.proof) for question in questions])


# The controller.

GIVE_BACK_S = 3.0
CAPABILITIES = Capabilities(
    stops=True,
    tables=(*HELD_KINDS, REVERSAL),
    switched="at-stop",
    marker=True,
    consent="start",
    grinding=True,
    cross_shown="either-way",
    self_test=True,
    together=True,
)


class SinumerikOpcUa(CleanupMixin, StopPlanMixin, KnownAs):
    """Driver "sinumerik-opcua": settings in `drivers.sinumerik.opcua.settings.UaSettings`."""

    def __init__(
        self, name: str, url: str, settings: Mapping[str, Any], clock: Clock, session: UaSession | None = None
    ) -> None:
        self.name, self._clock, self._settings = name, clock, UaSettings.read(settings, name)
        self._session = session or UaSession(url, clock, name)
        self._reader = MachineReader(self._session, self._settings, name)
        self._transfer = Transfer(self._session, self._settings.channel, name)
        self._dialogue = ProgramDialogue(self._session, self._reader, self._settings, clock=clock, where=name)
        parts = (self._dialogue, self._reader, self._transfer)
        self._pushing = Pushing(*parts, settings=self._settings, clock=clock, where=name)
        self._disabling = Disabling(*parts, pushing=self._pushing, where=name)
        together = self._settings.plans_together
        self._measuring = Measuring(self._dialogue, self._transfer, clock=clock, where=name, together=together)
        self._self_testing = SelfTesting(self._dialogue, self._transfer, pushing=self._pushing, where=name)
        self._grinding = PartGrinding(*parts, settings=self._settings, clock=clock, where=name)
        self._held = HeldNumbers(
            self._session, self._reader, settings=self._settings, dialogue=self._dialogue, where=self.name
        )
        self._leaving = ProgramWithdrawal(
            *parts, channel=self._settings.channel, clock=clock, where=name, reopen=self._open_again
        )
        self._configuration = Configuration((), (), ())
        self._dialogue.reopen = self._rejoin
        self._machine: MachineIdentity | None = None

    # ---- device -------------------------------------------------------------------------------------

    async def open(self, timeout_s: float) -> Identity:
        """Log in and read who the machine is; the limit then holds for every later request too.

        Raises what `UaSession.open` raises, ConfigError (E-UA-SECRET), UnsupportedDevice (E-UA-ABSENT).
        """
        self._reader.timeout_s = self._transfer.timeout_s = timeout_s
        secrets = await asyncio.to_thread(read_secrets, self._settings, self.name)
        writing = await asyncio.to_thread(read_writing_secrets, self._settings, secrets, self.name)
        await self._session.open(secrets, timeout_s, writing)
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

    async def _rejoin(self) -> None:
        """A fresh session with the same machine. Raises as `open`, DeviceRefused (E-UA-OTHER) for another one."""
        serial = self._machine.serial if self._machine is not None else ""
        found = await self.open(self._reader.timeout_s)
        if serial and found.serial != serial:
            await self._session.close()
            raise DeviceRefused("E-UA-OTHER", self.name, serial=serial, found=found.serial)

    async def identify(self) -> MachineIdentity:
        """Serial number, NCK version, axis names, unit system and what the settings name besides, read afresh."""
        self._configuration = await self._reader.configuration()
        self._dialogue.names = self._configuration.places
        self._machine = self.called(await self._reader.identity(self._configuration.names))
        return self._machine

    async def state(self) -> MachineState:
        """Everything in one request. Raises TransportError (E-UA-NCK-DOWN) while the NCK restarts."""
        return await self._reader.state(self._configuration)

    @property
    def capabilities(self) -> Capabilities:
        """Programs of ours run; tables are switched at a stop of theirs; the marker stands in four R parameters."""
        settings = self._settings
        return replace(CAPABILITIES, one_start=settings.one_start, unprotected=settings.unprotected(""))

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        """MD38000 of an encoder or MD18342 of a table, six decimals of a mm or degree, our value limit, MD32720."""
        memory = await self._reader.memory(self._configuration, axis, 0 if kind == "cross" else index)
        unit = self._configuration.units[axis]
        if kind != "cross":
            return TableLimits(memory.eec_points if kind == "axis" else 1, VALUE_RESOLUTION, largest_value(unit))
        reserved = memory.cec_points[index] if 0 <= index < len(memory.cec_points) else 0
        largest = await self._reader.figure(f"$MA_CEC_MAX_SUM[{axis}]", self._configuration)
        return TableLimits(reserved, VALUE_RESOLUTION, largest_value(unit), largest)

    async def marker(self) -> Marker | None:
        """The last push as R parameters remember it, whoever made it."""
        return await self._pushing.marker()

    # ---- measuring ----------------------------------------------------------------------------------

    async def abort_program(self) -> None:
        """Set the abort word: a program of ours that waits, now or at its start, leaves to its end.

        Raises DeviceRefused (E-NC-ANOTHER) with nothing written when another gateway's program stands there.
        """
        await self._dialogue.check_own()
        self._measuring.cut()
        await self._dialogue.write({Word.ABORT: 1.0})
        self._dialogue.pace.again()

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        """By a program that the operator starts; it moves nothing. Raises as `read_live_tables`."""
        return (await read_live_tables(self, (question,), tell))[0]

    async def live_tables_of(self, questions: Sequence[TableQuestion], tell: Tell) -> tuple[LiveSet, ...]:
        """As `drivers.ports.controller.ReadsTogether.live_tables_of`. Raises as `read_live_tables`."""
        asked = {question.axis: question.encoder for question in questions}
        again = await self._pushing.read_again(asked, self._configuration)
        if again is None:
            return await read_live_tables(self, questions, tell)
        known = dict(zip(asked, again, strict=True))
        return tuple([await self._by(known[one.axis], one.axis, one.proof) for one in questions])

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """As `tables.tables_by_proof`."""
        return tables.tables_by_proof(live, proof)

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        """As `tables.table_by_proof`."""
        return tables.table_by_proof(table, sense, proof)

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """The live tables the last program wrote before moving. Raises DeviceRefused (E-NC-NOT-SAVED, E-UA-FILE...)."""
        saved = self._measuring if self._grinding.plan is None else self._grinding
        return await self._by(await saved.saved_tables(axis, self._configuration), axis, proof)

    async def _by(self, live: LiveSet, axis: str, proof: SignProof | None) -> LiveSet:
        live = tables.tables_by_proof(live, proof)
        return replace(live, temperature=await self._reader.temperature(self._configuration, axis))

    async def prepare_self_test(self, order: SelfTest) -> None:
        """Send, read back and select the program. Raises as `prepare_stops`."""
        setting = await self._setting(order.axis, order.axis, order.encoder, rotary=False)
        await self._check_encoder(order.axis, order.encoder, said=order.encoder_said)
        await self._other_program()
        await self._self_testing.prepare(order, setting)

    async def wait_self_test(self, order: SelfTest, timeout_s: float) -> SelfTested:
        """Wait for its end and read its report. Raises as `SelfTesting.tested`."""
        machine, utc = await self.identify(), self._clock.utc().isoformat(timespec="seconds")
        return await self._self_testing.tested(order, timeout_s, machine=machine, utc=utc)

    async def _other_program(self) -> None:
        """What is sent next neither measures nor grinds: tables saved before are no answer any more."""
        await self._measuring.leave()
        self._measuring.forget()
        self._grinding.plan, self.going = None, ()

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Place the set-up values, send, read back and select the program. Raises as its `prepare`."""
        await self._other_program()
        self._grinding.guards = await self._guards(*(axis.name for axis in plan.axes))
        self._grinding.loops = LOOPS not in self._without
        text = await self._grinding.prepare(plan, self._configuration)
        self._grinds(plan, self._configuration.units)
        return text

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Spaces done so far, None when the program has ended. Raises as `PartGrinding.ground`."""
        return await self._grinding.ground(after, timeout_s)

    async def held_values(self, places: Sequence[str]) -> tuple[float, ...]:
        """As `drivers.ports.controller.HoldsValues.held_values`. Raises as `HeldNumbers.read`."""
        return await self._held.read(places)

    async def hold_values(self, values: Mapping[str, float]) -> None:
        """As `drivers.ports.controller.HoldsValues.hold_values`. Raises as `HeldNumbers.write`."""
        await self._held.write(values)

    # ---- pushing ------------------------------------------------------------------------------------

    async def stage(self, batch: PushBatch) -> None:
        """Send, read back and select one program of two halves for all tables. Raises as `Pushing.prepare`."""
        loads: list[tuple[PushOrder, MachineSetting]] = []
        for order in batch:
            table, encoder = order.table, order.saved_encoder
            setting = await self._setting(table.input_axis, table.output_axis, encoder, rotary=order.rotary)
            if order.purpose != "restore":
                await self._check_encoder(table.output_axis, encoder, said=order.encoder_said)
            loads.append((order, replace(setting, guards=self._all_guards())))
        await self._other_program()
        await self._pushing.prepare(loads)
        self._goes({order.letter: (order.table.input_axis, order.table.input_unit) for order in batch})

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        """Back-up of the old and read-back of the new at the end of the first half. Raises as `Pushing.loaded`."""
        return await self._pushing.loaded(batch, timeout_s, self._configuration)

    async def saved_first(self, batch: PushBatch, timeout_s: float) -> tuple[LiveSet, ...]:
        """As `drivers.ports.controller.SavesFirst.saved_first`, with one program alone. Raises as `Pushing.saved`."""
        return await self._pushing.saved(batch, timeout_s, self._configuration)

    async def never_started(self, batch: PushBatch) -> bool:
        """As `drivers.ports.controller.TellsUnstarted.never_started`."""
        return await self._pushing.never_started(batch)

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch, from the files that its own program wrote. Raises as `Pushing.backup`."""
        return await self._pushing.backup(batch, self._configuration)

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        """Set the release word to the transaction number; never retried. Two programs: select the second."""
        await self._pushing.release(batch, passed)

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """True where the second half switched a table on, false when it, or a reset, left it off."""
        return await self._pushing.enabled(passed, timeout_s, self._configuration)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """Wait through NCK reset and reference run. Raises DeadlineExceeded (E-NC-NO-ACTIVATION)."""
        await self._pushing.restarted(passed, timeout_s)

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
        encoder = 0 if order.kind == "cross" else order.index
        setting = await self._setting(order.axis, order.axis, encoder, rotary=False)
        await self._other_program()
        await self._disabling.prepare(order, setting)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Wait for that program's end and read back. Raises as `Disabling.disabled`."""
        return await self._disabling.disabled(order, timeout_s, self._configuration)

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state. Never retried."""
        await self._pushing.mark(batch, state)
