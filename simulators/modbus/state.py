"""What the PLC's commands find and ask: release, session, retentive memory, and the checks before each command.

The release at the panel counts if given after command 1 of the session, and for a quarter of an hour. A command is a
generator: it yields the seconds until it is called again, so the program cycle stays in charge of time. The release's
quarter of an hour passes by the clock of person and PC, not by that of a machine simulated faster.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Protocol

from drivers.clock import Clock
from simulators.modbus import registers as r
from simulators.modbus.registers import (
    BACKLASH_KIND,
    CEC,
    EEC,
    NOT_IN_RESET,
    NOT_RELEASED,
    OUT_OF_ORDER,
    PROTECTED,
    RANGE,
    UNKNOWN,
    PlcCommand,
    PlcFault,
    ProcessImage,
    TableAddress,
)
from simulators.modbus.settings import PlcSettings
from simulators.modbus.table_access import TableAccess
from simulators.nck import ForgottenMemory

COUNTS_S = 900.0


class PlcRelease:
    """A switch that a person turns; what counts is the turn from off to on while a session is open."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._session = 0
        self._given_s: float | None = None
        self.on = False
        self.was_given = False

    def begin(self, session: int) -> None:
        """A session begins, or ends (0): what was given before counts no more."""
        self._session, self._given_s, self.was_given = session, None, False

    def set(self, on: bool) -> None:
        """The switch at the panel."""
        if on and not self.on and self._session:
            self._given_s, self.was_given = self._clock.now(), True
        if not on:
            self._given_s = None
        self.on = on

    def give(self) -> None:
        """Off, and on again: a person gives it anew."""
        self.set(False)
        self.set(True)

    @property
    def stands(self) -> bool:
        """Given in this session and not taken back."""
        return self._given_s is not None

    @property
    def counts(self) -> bool:
        """Given in this session, not taken back, and not too long ago."""
        return self.left_s > 0

    @property
    def left_s(self) -> int:
        """Whole seconds that it counts for, 0 for none."""
        if self._given_s is None:
            return 0
        return max(0, math.ceil(self._given_s + COUNTS_S - self._clock.now()))


# A command gives the seconds until it is called again, and ends by returning or by PlcFault.
CommandSteps = Generator[float, None, None]


class PlcPowerCut(Exception):
    """The mains fail."""


@dataclass(slots=True)
class TableLoad:
    """A table being loaded: the begin command, and the points' values and words received so far."""

    begin: PlcCommand
    target: TableAddress
    values: list[int] = field(default_factory=list)
    words: list[int] = field(default_factory=list)
    lost: set[int] = field(default_factory=set)


@dataclass(slots=True)
class RetentiveMemory:
    """What outlives a power cut."""

    marker: tuple[int, ...] = (0,) * 8
    marker_state: int = 0
    marker_head: tuple[int, ...] = (0,) * 4
    half: set[tuple[int, int, int]] = field(default_factory=set)


class PlcState(Protocol):
    """What the commands need of the PLC around them."""

    image: ProcessImage
    settings: PlcSettings
    memory: RetentiveMemory
    load: TableLoad | None
    session: int
    waiting: bool
    confirmed: bool
    claimed_off: set[tuple[int, int, int]]
    loads_done: int

    backlash: dict[tuple[int, int, int], int]
    release: PlcRelease

    def now(self) -> float:
        """Seconds of the PLC's clock."""
        ...

    def withdraw_release(self) -> None:
        """The person takes the release back."""
        ...

    def open_session(self, number: int) -> None:
        """A session begins."""
        ...

    def close_session(self) -> None:
        """The session ends."""
        ...

    def forget(self, what: ForgottenMemory) -> None:
        """What was kept is lost: words of the PLC, or points or switches of the control."""
        ...

    def switch_on_again(self, target: TableAddress) -> None:
        """A table that was just switched on is switched on once more, later, whatever was done to it since."""
        ...

    def switches(self, target: TableAddress) -> int:
        """The switch bits as the PLC shows them."""
        ...

    def is_off(self, target: TableAddress) -> bool:
        """Whether the PLC takes the table for off."""
        ...


# Checks: which table, machine at rest and released, sound parameters.


class CommandChecks:
    """The checks of one PLC."""

    def __init__(self, plc: PlcState, access: TableAccess) -> None:
        self._plc = plc
        self._access = access

    def target(self, command: PlcCommand, kinds: tuple[int, ...]) -> TableAddress:
        """The table a command names. Raises PlcFault (9)."""
        kind, index = command[r.KIND], command[r.INDEX]
        if kind not in kinds:
            raise PlcFault(UNKNOWN)
        found = TableAddress(kind, index, command[r.ENCODER], command[r.OUTPUT] if kind == CEC else index)
        self._access.check(found)
        return found

    def check_machine(self, *, no_alarm: bool = False) -> None:
        """Released, in reset, standing. Raises PlcFault (5, 6)."""
        if not self._plc.release.counts:
            raise PlcFault(NOT_RELEASED)
        self.check_rest(no_alarm=no_alarm)

    def check_rest(self, *, no_alarm: bool = False) -> None:
        """In reset, standing. Raises PlcFault (6)."""
        access = self._access
        alarm = access.first_alarm
        if not access.in_reset or not access.standstill or (no_alarm and alarm):
            raise PlcFault(NOT_IN_RESET, alarm)

    def check_off(self, target: TableAddress) -> None:
        """The table may be written. Raises PlcFault (7)."""
        if not self._plc.is_off(target):
            raise PlcFault(PROTECTED)

    def check_parameters(self, command: PlcCommand, target: TableAddress) -> None:
        """Registers 21..33 of begin. Raises PlcFault (9, 4 with the register's address)."""
        if target.kind == CEC:
            self._access.axis(command[r.INPUT])
        flags = command[r.FLAGS]
        cross = target.kind == CEC
        if target.kind == BACKLASH_KIND:
            _check_backlash(command)
            return
        zero = () if cross else (r.INPUT, r.OUTPUT, r.FACTOR)
        bad_flags = flags >> 1 & 3 == 3 or flags >> 4 if cross else flags >> 1
        factor = command[r.FACTOR] > self._access.tables
        span = command.maximum - command.minimum
        problems = (
            (bool(bad_flags), r.FLAGS),
            (command.step <= 0, r.STEP),
            (not 0 <= span - command.step * (command[r.TOTAL] - 1) < command.step, r.MAXIMUM),
            (command[r.TOTAL] < 2, r.TOTAL),
            *((command[address] != 0, address) for address in zero),
            (factor, r.FACTOR),
        )
        for wrong, address in problems:
            if wrong:
                raise PlcFault(RANGE, address)

    def check_load(self, command: PlcCommand, kinds: tuple[int, ...] = (EEC, CEC, BACKLASH_KIND)) -> TableLoad:
        """The load that chunk and verify go on with, other parameters refused (4)."""
        load = self._plc.load
        if load is None:
            raise PlcFault(OUT_OF_ORDER)
        self.target(command, kinds)
        other = command.difference(load.begin)
        if other is not None:
            raise PlcFault(RANGE, other)
        return load


def _check_backlash(command: PlcCommand) -> None:
    """One value without a grid. Raises PlcFault (4 with the register's address)."""
    zero = (r.FLAGS, r.MINIMUM, r.STEP, r.MAXIMUM, r.TOTAL, r.INPUT, r.OUTPUT, r.FACTOR)
    found = (command[r.FLAGS], command.minimum, command.step, command.maximum, command[r.TOTAL] - 1)
    for address, value in zip(zero, (*found, *(command[place] for place in zero[5:])), strict=True):
        if value:
            raise PlcFault(RANGE, address)
