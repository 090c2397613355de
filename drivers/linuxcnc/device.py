"""A LinuxCNC kernel behind the agent on its host, as a Controller: programs by hand-shake, tables by screw files.

A person starts every program with Cycle Start and restarts LinuxCNC for every new table: until then the old one acts.
Compensation values come in um or arcsec, positions in mm or deg. Reads may be repeated by the caller, a write never.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from drivers.clock import Clock
from drivers.errors import DeviceRefused, UnsupportedDevice, words
from drivers.exchange.linuxcnc import MOST_ROWS
from drivers.limits import VALUE_RESOLUTION, largest_value
from drivers.linuxcnc.loading import ScrewLoading, machine_of, unit_of
from drivers.linuxcnc.measuring import StopProgram, read_moves
from drivers.linuxcnc.settings import LinuxCncSettings
from drivers.linuxcnc.wire import AgentWire
from drivers.ports.devices import Tell
from drivers.safe_positions import SafePositionMixin
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableAbility, TableLimits
from drivers.types.identity import Identity, KnownAs, MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import Sense
from drivers.units import deviation_scale
from drivers.workpiece import GrindPlan

CAPABILITIES = Capabilities(
    stops=True,
    tables=(TableAbility("axis", "free", "columns", MOST_ROWS),),
    switched="by-restart",
    marker=True,
    consent="restart",
    together=True,
)
EMERGENCY, FAULT = 1, 10
"""LinuxCNC numbers no alarms: 1 is the emergency stop, 10 + n a fault of joint n."""


class LinuxCnc(SafePositionMixin, KnownAs):
    """Driver "linuxcnc-agent": settings in `drivers.linuxcnc.settings.LinuxCncSettings`; url tcp://host:port."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        found = LinuxCncSettings.read(settings, name)
        self._wire = AgentWire(url, found, clock, name)
        self._measuring = StopProgram(self._wire, found, clock, name)
        self._loading = ScrewLoading(self._wire, found, clock, name)
        self._can = replace(CAPABILITIES, unprotected=found.unprotected(url))

    @property
    def capabilities(self) -> Capabilities:
        """Programs run; one file a joint, two columns, 256 rows; a new one acts after a restart."""
        return self._can

    async def open(self, timeout_s: float) -> Identity:
        """Connect and read who the machine is. Raises as `AgentWire.open`, and as `identify`."""
        await self._wire.open(timeout_s)
        try:
            machine = await self.identify()
        except BaseException:
            await self._wire.close()
            raise
        return Identity("linuxcnc-agent", "LinuxCNC", machine.serial, machine.version)

    async def close(self) -> None:
        """Let go of the line. Never raises."""
        await self._wire.close()

    async def identify(self) -> MachineIdentity:
        """Name of the INI file and of this host's own; version; letters of the joints.

        Raises UnsupportedDevice (E-LCNC-KINS), TransportError (E-LCNC-DOWN).
        """
        said = await self._wire.read("identify")
        inches = any(not joint["rotary"] and joint["units"] != 1.0 for joint in said["joints"])
        if inches:
            raise UnsupportedDevice("E-LCNC-INCH", self.name)
        return self.called(machine_of(said))

    async def state(self) -> MachineState:
        """Interpreter, mode and every joint, read afresh. ``encoder_compensation`` is minus the trim that acts."""
        said = await self._wire.read("state")
        axes = {joint["letter"]: _axis(joint) for joint in said["joints"]}
        channel = ChannelStatus[said["channel"]]
        alarms = [EMERGENCY] if said["emergency"] else []
        alarms += [FAULT + joint["joint"] for joint in said["joints"] if joint["fault"]]
        message = "; ".join(_alarm(number) for number in alarms)
        told = {"message": message, "alarms": tuple(alarms), "access_level": 0, "program": said["program"]}
        return MachineState(channel, said["mode"], axes=axes, **told)

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        """256 rows where the INI file names a COMP_FILE, else none. Raises DeviceRefused (E-LCNC-AXIS)."""
        if kind != "axis" or index:
            raise UnsupportedDevice("E-LCNC-TABLE", self.name, axis=axis)
        joint = (await self._wire.read("tables", axis=axis))["joint"]
        return TableLimits(MOST_ROWS if joint["file"] else 0, VALUE_RESOLUTION, largest_value(unit_of(joint)))

    async def marker(self) -> Marker | None:
        """The last push, from the marker file beside the INI file."""
        return await self._loading.marker()

    # ---- measuring ----------------------------------------------------------------------------------

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Place, read back and select a plan's program. Raises as `StopProgram.prepare`."""
        await self._measuring.prepare(plan)
        self.going = (read_moves(plan),)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a counter above ``after``; None when the program has ended. Raises as `StopProgram.wait`."""
        return await self._measuring.wait(after, timeout_s)

    async def release_stop(self, counter: int) -> None:
        """Raise the input that the program waits for until it says the counter back. Never retried."""
        await self._measuring.release(counter)

    async def abort_program(self) -> None:
        """End our program at its wait."""
        await self._measuring.abort()

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Not on this road. Raises UnsupportedDevice (E-GRIND-NO-PROGRAMS)."""
        raise UnsupportedDevice("E-GRIND-NO-PROGRAMS", self.name, part=plan.part)

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Not on this road. Raises UnsupportedDevice (E-GRIND-NO-PROGRAMS)."""
        del after, timeout_s
        raise UnsupportedDevice("E-GRIND-NO-PROGRAMS", self.name, part="")

    # ---- tables -------------------------------------------------------------------------------------

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        """As `saved_tables`: no program is needed for it; the next start's file where the question says ``loaded``."""
        del tell
        return await (self._loading.standing if question.loaded else self._loading.acting)(question.axis)

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """It has no cross tables, so there is nothing to turn."""
        del proof
        return live

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        """It has no cross tables, so there is nothing to turn."""
        del sense, proof
        return table

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """What this life of the kernel read when it started. Raises DeviceRefused (E-LCNC-EDITED)."""
        del proof
        return await self._loading.acting(axis)

    async def stage(self, batch: PushBatch) -> None:
        """Judge every table, keep what stands, set the marker. Raises as `ScrewLoading.begin`."""
        await self._loading.begin(batch)
        self.going = ()

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        """Old and new; the new file lies beside the one that acts."""
        del timeout_s
        return await self._loading.loaded(batch)

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch, as the host keeps it. Raises DeviceRefused (E-LCNC-KEPT)."""
        return await self._loading.backup(batch)

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        """The files of those that passed take the old ones' place; a person's restart puts them to work."""
        del batch
        await self._loading.take_over(passed)

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """What was ordered; one that is to be off is off only after the restart, which is waited for."""
        if not all(order.enable for order in passed):
            await self.restarted(passed, timeout_s)
        return tuple(order.enable for order in passed)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """The files that stand are what the kernel read, its axes homed. Raises DeadlineExceeded (E-LCNC-RESTART)."""
        await self._loading.restarted([order.table.output_axis for order in passed], timeout_s)

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Not on this road. Raises UnsupportedDevice (E-LCNC-SWITCHING)."""
        del order, enable, timeout_s
        raise UnsupportedDevice("E-LCNC-SWITCHING", self.name)

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        """Whether the file that acts has rows, None while another waits for the next start; and the acting value."""
        live, state = await self._loading.standing(order.axis), await self.state()
        return SwitchReading(None if live.waits else live.own.enabled, state.axes[order.axis].encoder_compensation)

    async def prepare_disable(self, order: DisableOrder) -> None:
        """See that the axis has a file. Raises DeviceRefused (E-LCNC-NO-FILE, E-LCNC-BUSY)."""
        state = await self.state()
        if state.channel is not ChannelStatus.RESET:
            raise DeviceRefused("E-LCNC-BUSY", self.name, program=state.program)
        if not (await self.table_limits(order.axis)).reserved_points:
            raise DeviceRefused("E-LCNC-NO-FILE", self.name, joint=order.axis)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """A file without rows, then the person's restart. Raises DeadlineExceeded (E-LCNC-RESTART)."""
        await self._loading.clear(order.axis)
        await self._loading.restarted([order.axis], timeout_s)
        return await self.switch_reading(order)

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state."""
        await self._loading.finish(batch, state)


def _alarm(number: int) -> str:
    return words("W-LCNC-EMERGENCY") if number == EMERGENCY else words("W-LCNC-FAULT", joint=number - FAULT)


def _axis(joint: Mapping[str, Any]) -> AxisState:
    unit = unit_of(joint)
    acting = -float(joint["trim"]) * deviation_scale(unit) + 0.0
    return AxisState(
        name=joint["letter"],
        position=joint["position"],
        referenced=joint["homed"],
        in_position=joint["in_position"],
        encoder_compensation=acting,
        cross_compensation=0.0,
        unit=unit,
    )
