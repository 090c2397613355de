"""A motion program of one axis: stop, hand-shake, next stop."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.types.tables import CompensationTable
from drivers.types.values import Approach
from drivers.units import AxisUnit


@dataclass(frozen=True, slots=True)
class Stop:
    """One place where the axis stands and waits to be measured.

    ``target`` in the axis unit, approached in direction ``approach``. ``switch`` turns the plan's table (the
    output axis' own, or its ``cross_table``) on or off before the reading (None leaves it). ``label`` says what
    the stop is for (an index in the plan).
    """

    target: float
    approach: Approach
    repetition: int = 0
    label: int = 0
    switch: bool | None = None


@dataclass(frozen=True, slots=True)
class StopPlan:
    """A motion programme of one axis: stop, hand-shake, next stop. Positions are machine coordinates.

    ``setup`` is the operator's message shown before the first move ("" for none).
    ``feed`` in mm/min or deg/min; ``overrun`` moves beyond reversal so that each stop is approached from
    its own side; ``dwell_s`` passes before each hand-shake; ``save_tables`` writes the live tables first.
    ``further``: stops that a reading asks for may follow in the same program, between the ends of its own moves.
    ``output_axis`` ("": the axis that moves) is the one whose tables are saved and whose compensation is shown,
    ``encoder`` its measuring system, ``encoder_said`` whether a person named it; ``cross_table`` is the cross table
    that stops switch (None: its own), ``reversal`` the constant reversal that they switch in place of a table.
    """

    name: str
    axis: str
    letter: str
    unit: AxisUnit
    rotary: bool
    stops: tuple[Stop, ...]
    feed: float
    overrun: float
    dwell_s: float
    setup: str = ""
    save_tables: bool = True
    encoder: int = 0
    output_axis: str = ""
    cross_table: int | None = None
    encoder_said: bool = True
    reversal: CompensationTable | None = None
    further: bool = False

    @property
    def compensated_axis(self) -> str:
        """The axis whose tables this plan is about."""
        return self.output_axis or self.axis


@dataclass(frozen=True, slots=True)
class StopReached:
    """The controller stands at a stop and waits: ``counter`` must be echoed to let it go on."""

    counter: int
    repetition: int
    label: int
    approach: Approach
    target: float
    encoder_compensation: float
    cross_compensation: float
