"""The mailbox's commands: loading a table, switching tables, and the dispatch of all commands.

A table arrives in chunks (2, 3), is verified and written to the NCK as a whole (4), and is read back from there (7).
Tables are switched on after a person's confirmation at the panel (5), or off (6), several in one command. Every command
is checked in one order first: number, check sum, session, then its own conditions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from simulators.modbus import registers as r
from simulators.modbus.registers import (
    BACKLASH_KIND,
    CEC,
    DIFFERS,
    EEC,
    LENGTH,
    NCK_REFUSED,
    NO_CRC,
    NO_SESSION,
    NOT_IN_RESET,
    NOT_RELEASED,
    OUT_OF_ORDER,
    RANGE,
    SESSION_TAKEN,
    TEMPERATURE,
    TIME_OVER,
    TOO_MANY,
    UNKNOWN,
    PlcCommand,
    PlcFault,
    TableAddress,
    TableParameters,
)
from simulators.modbus.state import CommandChecks, CommandSteps, PlcPowerCut, PlcState, TableLoad
from simulators.modbus.table_access import TableAccess

PARAMETERS_DIFFER = 65535


class TableLoading:
    """Loads and reads tables."""

    def __init__(self, plc: PlcState, access: TableAccess, checks: CommandChecks) -> None:
        self._plc = plc
        self._access = access
        self._checks = checks

    def begin(self, command: PlcCommand) -> CommandSteps:
        """Command 2."""
        target = self._checks.target(command, (EEC, CEC, BACKLASH_KIND))
        self._checks.check_parameters(command, target)
        self._checks.check_machine()
        self._checks.check_off(target)
        reserved = self._access.reserved(target)
        if command[r.TOTAL] > reserved:
            raise PlcFault(TOO_MANY, reserved)
        self._plc.memory.half.add(target.table)
        self._plc.backlash.pop(target.table, None)
        self._plc.load = TableLoad(command, target)
        yield from ()

    def chunk(self, command: PlcCommand) -> CommandSteps:
        """Command 3."""
        load = self._checks.check_load(command)
        first, count, stored = command[r.FIRST], command[r.COUNT], len(load.values)
        fits = first == stored and 1 <= count <= r.MOST_POINTS and first + count <= command[r.TOTAL]
        if not fits and not self._plc.settings.accepts_wrong_length:
            raise PlcFault(LENGTH, stored)
        self._checks.check_machine()
        self._checks.check_off(load.target)
        yield self._plc.settings.scan_s
        self._take(load, command, min(count, r.MOST_POINTS))

    def _take(self, load: TableLoad, command: PlcCommand, count: int) -> None:
        settings, words = self._plc.settings, command.data[: 2 * count]
        low_first = settings.low_first != settings.swap_data_words
        first = len(load.values)
        load.words += words
        load.values += [r.dint_of(words[2 * k], words[2 * k + 1], low_first) for k in range(count)]
        if settings.lose_points:
            load.lost |= set(range(max(first, first + count - settings.lose_points), first + count))

    def verify(self, command: PlcCommand) -> CommandSteps:
        """Command 4."""
        load = self._checks.check_load(command)
        total, stored = command[r.TOTAL], len(load.values)
        if stored != total and not self._plc.settings.accepts_wrong_length:
            raise PlcFault(LENGTH, stored)
        self._checks.check_machine()
        self._checks.check_off(load.target)
        if load.target.kind == BACKLASH_KIND:
            self._plc.backlash[load.target.table] = load.values[0]  # written when it is switched on
            self._loaded(load)
            return
        wanted = _parameters_of(command, load.target)
        first = self._plc.settings.parameters_first
        if first:
            self._access.put_parameters(load.target, wanted)
        yield from self._put_points(load)
        if not first:
            self._access.put_parameters(load.target, wanted)
        yield self._plc.settings.scan_s
        if not self._plc.settings.careless:
            yield from self._compare(load, wanted)
        self._loaded(load)

    def _loaded(self, load: TableLoad) -> None:
        self._plc.memory.half.discard(load.target.table)
        self._plc.load = None
        self._plc.loads_done += 1

    def _put_points(self, load: TableLoad) -> CommandSteps:
        """Every point and zeros above them, so many in a cycle."""
        settings, reserved = self._plc.settings, self._access.reserved(load.target)
        values = (load.values + [0] * reserved)[:reserved]
        for place, value in enumerate(values):
            if place not in load.lost:
                self._access.put_point(load.target, place, self._coarse(value), float32=settings.float32_values)
            if place + 1 == self._plc.settings.power_cut_after:
                raise PlcPowerCut
            if place % settings.points_a_scan == settings.points_a_scan - 1:
                yield settings.scan_s

    def _coarse(self, value: int) -> int:
        quantum = self._plc.settings.quantum_points
        return round(value / quantum) * quantum if quantum else value

    def _compare(self, load: TableLoad, wanted: TableParameters) -> CommandSteps:
        """Read back from the NCK and compare. Raises PlcFault (10)."""
        a_scan, reserved = self._plc.settings.points_a_scan, self._access.reserved(load.target)
        values = (load.values + [0] * reserved)[:reserved]
        for first in range(0, reserved, a_scan):
            sent = values[first : first + a_scan]
            found = self._access.points(load.target, first, len(sent))
            for place, (old, new) in enumerate(zip(sent, found, strict=True), start=first):
                if self._coarse(old) != new and place not in load.lost:
                    raise PlcFault(DIFFERS, place)
            yield self._plc.settings.scan_s
        if self._access.parameters(load.target) != wanted:
            raise PlcFault(DIFFERS, PARAMETERS_DIFFER)

    def read_back(self, command: PlcCommand) -> CommandSteps:
        """Command 7."""
        target = self._checks.target(command, (EEC, CEC, BACKLASH_KIND, TEMPERATURE))
        first, count = command[r.FIRST], command[r.COUNT]
        if not 1 <= count <= r.MOST_POINTS:
            raise PlcFault(LENGTH)
        if not self._access.ready:
            raise PlcFault(NOT_IN_RESET)
        reserved = self._access.reserved(target)
        if first + count > reserved:
            raise PlcFault(TOO_MANY, reserved)
        yield self._plc.settings.scan_s
        self._put_read_back(command, self._access.points(target, first, count))

    def _put_read_back(self, command: PlcCommand, values: list[int]) -> None:
        image = self._plc.image
        for place in range(r.MOST_POINTS):
            image.put_dint(r.READ_BACK + 2 * place, values[place] if place < len(values) else 0)
        crc = r.crc_of(command.head + tuple(image.words[r.READ_BACK : r.READ_BACK_CRC]))
        image.put_dint(r.READ_BACK_CRC, crc ^ self._plc.settings.wrong_read_back_crc)


def _parameters_of(command: PlcCommand, target: TableAddress) -> TableParameters:
    own = target.kind == EEC
    return TableParameters(
        flags=command[r.FLAGS],
        minimum=command.minimum,
        step=command.step,
        maximum=command.maximum,
        input_axis=target.index if own else command[r.INPUT],
        output_axis=target.index if own else command[r.OUTPUT],
        factor=command[r.FACTOR],
    )


# Commands 5 and 6: on and off.

AXIS_ALONE, TABLE_ALONE, ANYHOW = 1 << 4, 1 << 5, 1 << 6
LOOK_S = 0.1


@dataclass(frozen=True, slots=True)
class SwitchEntry:
    """One table of a command: which, and how its switches are set."""

    target: TableAddress
    flags: int

    @property
    def bits(self) -> int:
        """The switches that this entry sets (register 366)."""
        if self.target.kind != CEC:
            return 1 if self.target.kind == EEC else 8
        return 2 if self.flags & AXIS_ALONE else 4 if self.flags & TABLE_ALONE else 6


class PlcSwitching:
    """Switches tables."""

    def __init__(self, plc: PlcState, access: TableAccess, checks: CommandChecks) -> None:
        self._plc = plc
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
        target = TableAddress(kind, index, encoder, axis)
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

    def activate(self, command: PlcCommand) -> CommandSteps:
        """Command 5."""
        entries = self.entries(command)
        if command[r.FLAGS]:
            raise PlcFault(RANGE, r.FLAGS)
        self._check_activation(entries)
        yield from self._confirmed()
        if self._plc.settings.key_back:
            self._plc.withdraw_release()
        self._check_activation(entries)
        yield from self._switched(entries, on=True)
        if self._plc.settings.enables_twice_s > 0.0:
            self._plc.switch_on_again(entries[-1].target)

    def _check_activation(self, entries: tuple[SwitchEntry, ...]) -> None:
        self._checks.check_machine(no_alarm=True)
        for place, entry in enumerate(entries, start=1):
            table = entry.target.table
            waiting = entry.target.kind != BACKLASH_KIND or table in self._plc.backlash
            if table in self._plc.memory.half or not waiting:
                raise PlcFault(DIFFERS, place)

    def _confirmed(self) -> CommandSteps:
        """Wait for the button at the panel. Raises PlcFault (12)."""
        plc = self._plc
        end = plc.now() + plc.settings.confirm_s
        plc.confirmed, plc.waiting = False, True
        try:
            while not plc.confirmed:
                if plc.now() >= end:
                    raise PlcFault(TIME_OVER)
                yield LOOK_S
        finally:
            plc.waiting = False

    def disable(self, command: PlcCommand) -> CommandSteps:
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
        if self._plc.settings.lies_about_disable:
            self._plc.claimed_off |= {entry.target.table for entry in entries}
            return
        yield from self._switched(entries, on=False)

    def _check_release(self) -> None:
        if not self._plc.release.stands:
            raise PlcFault(NOT_RELEASED)

    def _switched(self, entries: tuple[SwitchEntry, ...], *, on: bool) -> CommandSteps:
        """Each in its turn, then NEWCONF, then each is looked at."""
        for entry in entries:
            if entry.target.kind == BACKLASH_KIND:
                self._access.set_backlash(entry.target, self._backlash(entry) if on else 0)
            else:
                alone, table = bool(entry.flags & AXIS_ALONE), bool(entry.flags & TABLE_ALONE)
                self._access.switch(entry.target, on=on, axis_alone=alone, table_alone=table)
        self._access.activate_switches()
        yield self._plc.settings.scan_s
        self._plc.claimed_off -= {entry.target.table for entry in entries}
        for entry in entries:
            if not self._stands_so(entry, on):
                raise PlcFault(NCK_REFUSED)

    def _backlash(self, entry: SwitchEntry) -> int:
        return self._plc.backlash[entry.target.table] + self._plc.settings.other_backlash

    def _stands_so(self, entry: SwitchEntry, on: bool) -> bool:
        if entry.target.kind == BACKLASH_KIND:
            return self._access.backlash(entry.target) == (self._backlash(entry) if on else 0)
        return self._access.switches(entry.target) & entry.bits == (entry.bits if on else 0)


# Dispatch.

OPEN, BEGIN, CHUNK, VERIFY, ACTIVATE, DISABLE, READ_BACK, ABORT, CLOSE, SET_MARKER, SELECT = range(1, 12)
SELECTING = frozenset({BEGIN, CHUNK, VERIFY, READ_BACK, SELECT})
WITH_DATA = frozenset({CHUNK, ACTIVATE, DISABLE, SET_MARKER})
_WITHOUT_SESSION = frozenset({OPEN, SELECT})
_ALARM = 700016  # a user alarm of the PLC


class PlcCommands:
    """Checks and runs the commands of one PLC."""

    def __init__(self, plc: PlcState, access: TableAccess) -> None:
        self._plc = plc
        self._access = access
        self.checks = CommandChecks(plc, access)
        loading = TableLoading(plc, access, self.checks)
        self._switching = switching = PlcSwitching(plc, access, self.checks)
        self._works: dict[int, Callable[[PlcCommand], CommandSteps]] = {
            OPEN: self._open,
            BEGIN: loading.begin,
            CHUNK: loading.chunk,
            VERIFY: loading.verify,
            ACTIVATE: switching.activate,
            DISABLE: switching.disable,
            READ_BACK: loading.read_back,
            ABORT: self._abort,
            CLOSE: self._close,
            SET_MARKER: self._set_marker,
            SELECT: self._select,
        }

    def work(self, command: PlcCommand, expected: int, *, busy: bool) -> CommandSteps:
        """One command with all its checks; ``busy``: another one was under way."""
        code = command[r.COMMAND]
        if command[r.NUMBER] != expected:
            raise PlcFault(OUT_OF_ORDER, expected)
        if r.crc_of(self._covered(command)) != command.crc:
            raise PlcFault(NO_CRC)
        if code not in self._works:
            raise PlcFault(UNKNOWN)
        self._check_session(code)
        if (busy and code not in (ABORT, CLOSE)) or (code in (CHUNK, VERIFY) and self._plc.load is None):
            raise PlcFault(OUT_OF_ORDER, expected)
        yield from self._troubled(code)
        yield from self._works[code](command)

    def selected_by(self, command: PlcCommand) -> TableAddress | None:
        """What a command that was done selects: the table that it named, the last one of several, or nothing."""
        code = command[r.COMMAND]
        if code in (ACTIVATE, DISABLE):
            return self._switching.entries(command)[-1].target
        return self.checks.target(command, (command[r.KIND],)) if code in SELECTING else None

    def _covered(self, command: PlcCommand) -> tuple[int, ...]:
        code = command[r.COMMAND]
        if code in WITH_DATA:
            return command.head + command.data
        load = self._plc.load
        return command.head + tuple(load.words) if code == VERIFY and load is not None else command.head

    def _check_session(self, code: int) -> None:
        session = self._plc.session
        if code == OPEN and session:
            raise PlcFault(SESSION_TAKEN, session)
        if code not in _WITHOUT_SESSION and not session:
            raise PlcFault(NO_SESSION)

    def _troubled(self, code: int) -> CommandSteps:
        settings = self._plc.settings
        if settings.alarm_during == code:
            self._access.nck.drive_alarm(_ALARM, "PLC: coolant level low")
        if settings.nck_refuses == code:
            raise PlcFault(NCK_REFUSED, settings.nck_result)
        if settings.enables_itself == code:
            self._access.nck.enable_by_itself()
        if settings.forgets == code:
            self._plc.forget(settings.forgets_what)
        while self._plc.settings.busy_forever == code:
            yield LOOK_S

    # -- session, marker, selection ----------------------------------------------------------------

    def _open(self, command: PlcCommand) -> CommandSteps:
        if not command[r.INDEX]:
            raise PlcFault(RANGE, r.INDEX)
        self._plc.open_session(command[r.INDEX])
        yield from ()

    def _abort(self, _command: PlcCommand) -> CommandSteps:
        self._plc.load = None
        yield from ()

    def _close(self, _command: PlcCommand) -> CommandSteps:
        self._plc.close_session()
        yield from ()

    def _set_marker(self, command: PlcCommand) -> CommandSteps:
        state = command.data[8]
        if state > 3:
            raise PlcFault(RANGE, r.DATA + 8)
        if not self._plc.release.was_given:
            raise PlcFault(NOT_RELEASED)
        self._plc.memory.marker = command.data[:8]
        self._plc.memory.marker_state = state
        self._plc.memory.marker_head = command.data[9:13]
        yield from ()

    def _select(self, command: PlcCommand) -> CommandSteps:
        self.checks.target(command, (EEC, CEC, BACKLASH_KIND, TEMPERATURE))
        if not self._access.ready:
            raise PlcFault(NOT_IN_RESET)
        yield from ()
