"""A machine control that measures by hand-shake and takes compensation tables."""

from __future__ import annotations

from typing import Literal, Protocol, runtime_checkable

from drivers.ports.devices import Device, Tell
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import MachineIdentity
from drivers.types.machine import MachineState
from drivers.types.orders import DisableOrder, PushOrder, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import Sense
from drivers.workpiece import GrindPlan


@runtime_checkable
class Controller(Device, Protocol):
    """A machine controller that measures by hand-shake and takes compensation tables.

    Reads may be retried by the caller; a write is never retried: after DeadlineExceeded the outcome is
    unknown and must be read back. Nothing here starts a program: the operator does. What a control
    cannot do it declares, and refuses as unsupported; `drivers.contract` holds every controller to this port.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What this road can do."""
        ...

    async def identify(self) -> MachineIdentity:
        """Read the fingerprint afresh."""
        ...

    async def state(self) -> MachineState:
        """Read the machine state afresh."""
        ...

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        """Reserved points and value resolution: of encoder ``index`` or of cross table ``index``."""
        ...

    async def marker(self) -> Marker | None:
        """What the controller remembers of the last push, whoever made it; None without `Capabilities.marker`."""
        ...

    async def prepare_stops(self, plan: StopPlan) -> None:
        """Generate, send, read back and select the motion program; the operator starts it."""
        ...

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """Wait for a hand-shake counter above `after`; None when the program has ended instead.

        Raises DeadlineExceeded (no start or no progress), DeviceRefused (alarm: number in the fields).
        """
        ...

    async def release_stop(self, counter: int) -> None:
        """Echo the counter so that the axis may move on."""
        ...

    async def abort_program(self) -> None:
        """Ask the waiting program to end by its abort word; it leaves compensation as it is."""
        ...

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        """What compensates an axis now, read afresh; compensation stays as it is.

        Where only a program can read it, the driver makes that program and ``tell`` hears what the person is to do.
        Raises DeadlineExceeded (nobody started it), DeviceRefused (alarm, another way it ended).
        """
        ...

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """The live tables as the last `prepare_stops` program saved them before its first move.

        Without `Capabilities.stops` they are read directly, afresh. Cross tables are deviations by ``proof``, and as
        they are stored where that is None.
        """
        ...

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """A set that was read before, its cross tables now as deviations by ``proof`` (None: as stored); pure."""
        ...

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        """One table that was kept in ``sense``, now as a deviation by ``proof`` (None: as stored); pure."""
        ...

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        """Place set-up values, send, read back, select; its text. ConfigError, DeviceRefused, UnsupportedDevice."""

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        """Spaces done once > ``after`` (-1: begun), None: ended. Raises DeadlineExceeded, DeviceRefused (alarm...)."""

    async def stage(self, order: PushOrder) -> None:
        """Get ready to load: nothing of the compensation changes yet; the person at the machine starts it.

        Where programs load it, the program is generated, sent, read back and selected. What its abilities
        lack is refused here (TableError, DeviceRefused), with nothing sent. With `Capabilities.marker` the marker says
        in-progress with the order's number when this returns.
        """
        ...

    async def read_back(self, order: PushOrder, timeout_s: float) -> tuple[LiveSet, LiveSet]:
        """Disable, write, read all back; (back-up of the old, read-back of the new). The new one stays off.

        Cross tables of both are deviations by the order's proof. A
        table never loaded (step 0) is restored as such, or, where the road cannot say that, as zeros on the grid there.

        Raises PointsDiffer when every point was written and some read otherwise, TableActs when the control takes
        none because the table is on, DeviceRefused when it ended by another way.
        """
        ...

    async def backup_of(self, order: PushOrder) -> LiveSet:
        """What stood before ``order`` began, as the controller or this driver kept it under the order's number.

        With `Capabilities.stops` from the file that the order's first half wrote, also in a later process; else
        from `stage`, in the same process. Cross tables are deviations by the order's proof.
        Raises DeviceRefused when there is none, FileFormatError when it is not whole or of another order.
        """
        ...

    async def activate(self, order: PushOrder) -> None:
        """Release the loaded table under the transaction's number; what enables it is the person's next act."""
        ...

    async def confirm(self, order: PushOrder, timeout_s: float) -> bool:
        """Wait for the outcome: true if the table is switched on, or will be by the restart; false if left off."""
        ...

    async def restarted(self, order: PushOrder, timeout_s: float) -> None:
        """Wait while the operator restarts the control and references, until the table acts."""
        ...

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Switch the order's table on or off and wait until it acts or is gone, confirmed at the machine.

        Raises UnsupportedDevice unless `Capabilities.switched` is "by-itself", DeadlineExceeded,
        DeviceRefused.
        """
        ...

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        """The switch of the order's table and what acts on its axis, read afresh; writes and starts nothing."""
        ...

    async def prepare_disable(self, order: DisableOrder) -> None:
        """Get ready to switch a table off, wherever its axis stands; nothing changes yet.

        With `Capabilities.stops` a program that does only this is sent, read back and selected; the person at
        the machine starts it. Raises DeviceRefused when the machine may not be switched now.
        """
        ...

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Switch off, wait until nothing acts, read back; never retried. What is read is the answer, on or off.

        Raises DeadlineExceeded (nobody started the program, or unknown), DeviceRefused.
        """
        ...

    async def finish_push(self, order: PushOrder, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state (none: nothing is left of it) and end the talk about this order."""
        ...
