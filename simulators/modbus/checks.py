"""What the PLC asks before it does a command: which table, machine at rest and released, sound parameters."""

from __future__ import annotations

from simulators.modbus import registers as r
from simulators.modbus.access import NckAccess
from simulators.modbus.plcstate import Load, PlcDesk
from simulators.modbus.registers import PlcCommand
from simulators.modbus.target import (
    BACKLASH_KIND,
    CEC,
    EEC,
    NOT_IN_RESET,
    NOT_RELEASED,
    OUT_OF_ORDER,
    PROTECTED,
    RANGE,
    UNKNOWN,
    PlcFault,
    Target,
)


class Checks:
    """Checks at one desk."""

    def __init__(self, desk: PlcDesk, access: NckAccess) -> None:
        self._desk = desk
        self._access = access

    def target(self, command: PlcCommand, kinds: tuple[int, ...]) -> Target:
        """The table a command names. Raises PlcFault (9)."""
        kind, index = command[r.KIND], command[r.INDEX]
        if kind not in kinds:
            raise PlcFault(UNKNOWN)
        found = Target(kind, index, command[r.ENCODER], command[r.OUTPUT] if kind == CEC else index)
        self._access.check(found)
        return found

    def check_machine(self, *, no_alarm: bool = False) -> None:
        """Released, in reset, standing. Raises PlcFault (5, 6)."""
        if not self._desk.release.counts:
            raise PlcFault(NOT_RELEASED)
        self.check_rest(no_alarm=no_alarm)

    def check_rest(self, *, no_alarm: bool = False) -> None:
        """In reset, standing. Raises PlcFault (6)."""
        access = self._access
        alarm = access.first_alarm
        if not access.in_reset or not access.standstill or (no_alarm and alarm):
            raise PlcFault(NOT_IN_RESET, alarm)

    def check_off(self, target: Target) -> None:
        """The table may be written. Raises PlcFault (7)."""
        if not self._desk.is_off(target):
            raise PlcFault(PROTECTED)

    def check_parameters(self, command: PlcCommand, target: Target) -> None:
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

    def check_load(self, command: PlcCommand, kinds: tuple[int, ...] = (EEC, CEC, BACKLASH_KIND)) -> Load:
        """The load that chunk and verify go on with, other parameters refused (4)."""
        load = self._desk.load
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
