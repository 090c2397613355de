"""Commands 5 and 6: tables are switched on after a person's confirm at the panel, or off; several in one command."""

from __future__ import annotations

from dataclasses import dataclass

from simulators.modbus import registers as r
from simulators.modbus.access import NckAccess
from simulators.modbus.checks import Checks
from simulators.modbus.plcstate import PlcDesk, Work
from simulators.modbus.registers import PlcCommand
from simulators.modbus.target import (
    BACKLASH_KIND,
    CEC,
    DIFFERS,
    EEC,
    LENGTH,
    NCK_REFUSED,
    NOT_IN_RESET,
    NOT_RELEASED,
    RANGE,
    TIME_OVER,
    UNKNOWN,
    PlcFault,
    Target,
)

AXIS_ALONE, TABLE_ALONE, ANYHOW = 1 << 4, 1 << 5, 1 << 6
LOOK_S = 0.1


@dataclass(frozen=True, slots=True)
class SwitchEntry:
    """One table of a command: which, and how its switches are set."""

    target: Target
    flags: int

    @property
    def bits(self) -> int:
        """The switches that this entry sets (register 366)."""
        if self.target.kind != CEC:
            return 1 if self.target.kind == EEC else 8
        return 2 if self.flags & AXIS_ALONE else 4 if self.flags & TABLE_ALONE else 6


class PlcSwitching:
    """Switches tables."""

    def __init__(self, desk: PlcDesk, access: NckAccess, checks: Checks) -> None:
        self._desk = desk
        self._access = access
        self._checks = checks

    def entries(self, command: PlcCommand) -> tuple[SwitchEntry, ...]:
        """The tables of commands 5 and 6, all of them looked at. Raises PlcFault (3; 9 with the entry; 4)."""
        count = command[r.COUNT]
        if not 1 <= count <= r.MOST_ENTRIES:
            raise PlcFault(LENGTH)
        return tuple(self._entry(command, place) for place in range(count))

    def _entry(self, command: PlcCommand, place: int) -> SwitchEntry:
        at = r.ENTRY * place
        kind, index, encoder, axis, flags = command.data[at : at + r.ENTRY]
        target = Target(kind, index, encoder, axis)
        if kind not in (EEC, CEC, BACKLASH_KIND):
            raise PlcFault(UNKNOWN, place + 1)
        try:
            self._access.check(target)
        except PlcFault as fault:
            raise PlcFault(fault.code, place + 1) from fault
        if kind != CEC and axis != index:
            raise PlcFault(RANGE, r.DATA + at + 3)
        allowed = (0, AXIS_ALONE, TABLE_ALONE) if kind == CEC else (0,)
        if flags not in allowed:
            raise PlcFault(RANGE, r.DATA + at + 4)
        return SwitchEntry(target, flags)

    def activate(self, command: PlcCommand) -> Work:
        """Command 5."""
        entries = self.entries(command)
        if command[r.FLAGS]:
            raise PlcFault(RANGE, r.FLAGS)
        self._check_activation(entries)
        yield from self._confirmed()
        if self._desk.settings.key_back:
            self._desk.turn_key_back()
        self._check_activation(entries)
        yield from self._switched(entries, on=True)
        if self._desk.settings.enables_twice_s > 0.0:
            self._desk.do_again(entries[-1].target)

    def _check_activation(self, entries: tuple[SwitchEntry, ...]) -> None:
        self._checks.check_machine(no_alarm=True)
        for place, entry in enumerate(entries, start=1):
            table = entry.target.table
            waiting = entry.target.kind != BACKLASH_KIND or table in self._desk.backlash
            if table in self._desk.memory.half or not waiting:
                raise PlcFault(DIFFERS, place)

    def _confirmed(self) -> Work:
        """Wait for the button at the panel. Raises PlcFault (12)."""
        desk = self._desk
        end = desk.now() + desk.settings.confirm_s
        desk.confirmed, desk.waiting = False, True
        try:
            while not desk.confirmed:
                if desk.now() >= end:
                    raise PlcFault(TIME_OVER)
                yield LOOK_S
        finally:
            desk.waiting = False

    def disable(self, command: PlcCommand) -> Work:
        """Command 6; a person confirms where a program is at work or an axis moves."""
        entries = self.entries(command)
        if command[r.FLAGS] & ~ANYHOW:
            raise PlcFault(RANGE, r.FLAGS)
        self._check_release()
        if not self._access.ready:
            raise PlcFault(NOT_IN_RESET, self._access.first_alarm)
        if not (self._access.in_reset and self._access.standstill):
            if not command[r.FLAGS]:
                self._checks.check_rest()
            yield from self._confirmed()
            self._check_release()
            if not self._access.ready:
                raise PlcFault(NOT_IN_RESET, self._access.first_alarm)
        if self._desk.settings.lies_about_disable:
            self._desk.lied |= {entry.target.table for entry in entries}
            return
        yield from self._switched(entries, on=False)

    def _check_release(self) -> None:
        if not self._desk.release.stands:
            raise PlcFault(NOT_RELEASED)

    def _switched(self, entries: tuple[SwitchEntry, ...], *, on: bool) -> Work:
        """Each in its turn, then NEWCONF, then each is looked at."""
        for entry in entries:
            if entry.target.kind == BACKLASH_KIND:
                self._access.set_backlash(entry.target, self._backlash(entry) if on else 0)
            else:
                alone, table = bool(entry.flags & AXIS_ALONE), bool(entry.flags & TABLE_ALONE)
                self._access.switch(entry.target, on=on, axis_alone=alone, table_alone=table)
        self._access.let_act()
        yield self._desk.settings.scan_s
        self._desk.lied -= {entry.target.table for entry in entries}
        for entry in entries:
            if not self._stands_so(entry, on):
                raise PlcFault(NCK_REFUSED)

    def _backlash(self, entry: SwitchEntry) -> int:
        return self._desk.backlash[entry.target.table] + self._desk.settings.other_backlash

    def _stands_so(self, entry: SwitchEntry, on: bool) -> bool:
        if entry.target.kind == BACKLASH_KIND:
            return self._access.backlash(entry.target) == (self._backlash(entry) if on else 0)
        return self._access.switches(entry.target) & entry.bits == (entry.bits if on else 0)
