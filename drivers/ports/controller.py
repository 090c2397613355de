"""A machine control that measures by hand-shake and takes compensation tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

from drivers.ports.devices import Device, Tell
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import MachineIdentity
from drivers.types.machine import MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
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

    async def stage(self, batch: PushBatch) -> None:
        """Get ready to load: nothing of the compensation changes yet; the person at the machine starts it.

        Where programs load, one program for all tables is generated, sent, read back and selected. What its abilities
        lack is refused here (TableError, DeviceRefused), with nothing sent. With `Capabilities.marker` the marker says
        in-progress with the orders' number when this returns.
        """
        ...

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        """Disable all, write all, read all back; for each order what stood before and what stands now, still off.

        Cross tables of both are deviations by the order's proof. A
        table never loaded (step 0) is restored as such, or, where the road cannot say that, as zeros on the grid there.

        Raises PointsDiffer when every point was written and no table reads as sent, TableActs when the control takes
        none because a table is on, DeviceRefused when it ended by another way: all are off then.
        """
        ...

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        """What stood before the batch began, order by order, as the controller or this driver kept it under its number.

        With `Capabilities.stops` from the files that its first half wrote, also in a later process; else
        from `stage`, in the same process. Cross tables are deviations by the orders' proofs.
        Raises DeviceRefused when there is none, FileFormatError when it is not whole or of another batch.
        """
        ...

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        """Release those tables of the batch that ``passed`` names, at least one; the others stay off.

        What switches them is the person's next act.
        """
        ...

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """Wait for the outcome, order by order: true if switched on, now or by the restart; false if left off."""
        ...

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """Wait while the operator restarts the control once and references, until the tables act."""
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

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        """Leave the marker in its last state (none: nothing is left of it) and end the talk about this batch."""
        ...


@runtime_checkable
class SavesFirst(Protocol):
    """A controller whose program of both halves (`Capabilities.one_start`) stands after its back-up.

    It stands until `Controller.read_back` lets it go on; an abort ends it there with nothing changed.
    """

    async def saved_first(self, batch: PushBatch, timeout_s: float) -> tuple[LiveSet, ...]:
        """Wait for the start and the back-up: what stands there, order by order, before anything is switched.

        Raises as `Controller.read_back`, but that nothing of the compensation has changed.
        """
        ...


@runtime_checkable
class TellsUnstarted(Protocol):
    """A controller that can tell that the program of a batch never began, without the help of a person."""

    async def never_started(self, batch: PushBatch) -> bool:
        """Whether the program sent last for this batch never began and, if started now, ends before its first write.

        True only on evidence in the control; False also where it cannot be told. After `Controller.abort_program`.
        """
        ...


@runtime_checkable
class ReadsTogether(Protocol):
    """A controller that reads the tables of several axes by one program, so that one press starts it."""

    async def live_tables_of(self, questions: Sequence[TableQuestion], tell: Tell) -> tuple[LiveSet, ...]:
        """As `Controller.live_tables`, an answer for each question in order; at least one. Raises as it does."""
        ...


@runtime_checkable
class HoldsValues(Protocol):
    """A controller that holds numbers for the programs of its builder: R parameters, data of the user, offsets.

    A place is named as the control's own people name it; the driver says which names it takes.
    """

    async def held_values(self, places: Sequence[str]) -> tuple[float, ...]:
        """The numbers held there now, read afresh. Raises ConfigError (E-HELD-...) for a place that is none."""
        ...

    async def hold_values(self, values: Mapping[str, float]) -> None:
        """Write them by one request, never retried; what the control made of it is read by the caller.

        Raises ConfigError (E-HELD-...) and DeviceRefused (a program is active) with nothing written.
        """
        ...
