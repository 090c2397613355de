"""Commands 5 and 6: a table is switched on after a person's confirm at the panel, or off."""

from __future__ import annotations

from simulators.modbus import registers as r
from simulators.modbus.access import CEC, DIFFERS, EEC, NCK_REFUSED, RANGE, TIME_OVER, NckAccess, PlcFault, Target
from simulators.modbus.checks import Checks
from simulators.modbus.plcstate import PlcDesk, Work
from simulators.modbus.registers import PlcCommand

AXIS_ALONE = 1 << 4
LOOK_S = 0.1


class PlcSwitching:
    """Switches tables."""

    def __init__(self, desk: PlcDesk, access: NckAccess, checks: Checks) -> None:
        self._desk = desk
        self._access = access
        self._checks = checks

    def activate(self, command: PlcCommand) -> Work:
        """Command 5."""
        target = self._checks.target(command, (EEC, CEC))
        alone = bool(command[r.FLAGS] & AXIS_ALONE)
        if alone and target.kind == EEC:
            raise PlcFault(RANGE, r.FLAGS)
        self._check_activation(target)
        yield from self._confirmed()
        if self._desk.settings.key_back:
            self._desk.turn_key_back()
        self._check_activation(target)
        yield from self._switched(target, on=True, alone=alone)
        if self._desk.settings.enables_twice_s > 0.0:
            self._desk.do_again(target)

    def _check_activation(self, target: Target) -> None:
        self._checks.check_machine(no_alarm=True)
        if target.table in self._desk.memory.half:
            raise PlcFault(DIFFERS)

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
        """Command 6."""
        target = self._checks.target(command, (EEC, CEC))
        self._checks.check_machine()
        if self._desk.settings.lies_about_disable:
            self._desk.lied.add(target.table)
            return
        yield from self._switched(target, on=False)

    def _switched(self, target: Target, *, on: bool, alone: bool = False) -> Work:
        self._access.switch(target, on=on, axis_alone=alone)
        yield self._desk.settings.scan_s
        self._desk.lied.discard(target.table)
        bits = 1 if target.kind == EEC else 2 if alone else 6
        if self._access.switches(target) & bits != (bits if on else 0):
            raise PlcFault(NCK_REFUSED)
