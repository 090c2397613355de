"""Commands 2, 3, 4 and 7: a table comes in by chunks, goes into the NCK as a whole, and is read back from there."""

from __future__ import annotations

from simulators.modbus import registers as r
from simulators.modbus.access import NckAccess
from simulators.modbus.checks import Checks
from simulators.modbus.plcstate import Load, PlcDesk, PlcPowerCut, Work
from simulators.modbus.registers import PlcCommand
from simulators.modbus.target import (
    BACKLASH_KIND,
    CEC,
    DIFFERS,
    EEC,
    LENGTH,
    NOT_IN_RESET,
    TEMPERATURE,
    TOO_MANY,
    Parameters,
    PlcFault,
    Target,
)

PARAMETERS_DIFFER = 65535


class Loading:
    """Loads and reads tables."""

    def __init__(self, desk: PlcDesk, access: NckAccess, checks: Checks) -> None:
        self._desk = desk
        self._access = access
        self._checks = checks

    def begin(self, command: PlcCommand) -> Work:
        """Command 2."""
        target = self._checks.target(command, (EEC, CEC, BACKLASH_KIND))
        self._checks.check_parameters(command, target)
        self._checks.check_machine()
        self._checks.check_off(target)
        reserved = self._access.reserved(target)
        if command[r.TOTAL] > reserved:
            raise PlcFault(TOO_MANY, reserved)
        self._desk.memory.half.add(target.table)
        self._desk.backlash.pop(target.table, None)
        self._desk.load = Load(command, target)
        yield from ()

    def chunk(self, command: PlcCommand) -> Work:
        """Command 3."""
        load = self._checks.check_load(command)
        first, count, stored = command[r.FIRST], command[r.COUNT], len(load.values)
        fits = first == stored and 1 <= count <= r.MOST_POINTS and first + count <= command[r.TOTAL]
        if not fits and not self._desk.settings.accepts_wrong_length:
            raise PlcFault(LENGTH, stored)
        self._checks.check_machine()
        self._checks.check_off(load.target)
        yield self._desk.settings.scan_s
        self._take(load, command, min(count, r.MOST_POINTS))

    def _take(self, load: Load, command: PlcCommand, count: int) -> None:
        settings, words = self._desk.settings, command.data[: 2 * count]
        low_first = settings.low_first != settings.swap_data_words
        first = len(load.values)
        load.words += words
        load.values += [r.dint_of(words[2 * k], words[2 * k + 1], low_first) for k in range(count)]
        if settings.lose_points:
            load.lost |= set(range(max(first, first + count - settings.lose_points), first + count))

    def verify(self, command: PlcCommand) -> Work:
        """Command 4."""
        load = self._checks.check_load(command)
        total, stored = command[r.TOTAL], len(load.values)
        if stored != total and not self._desk.settings.accepts_wrong_length:
            raise PlcFault(LENGTH, stored)
        self._checks.check_machine()
        self._checks.check_off(load.target)
        if load.target.kind == BACKLASH_KIND:
            self._desk.backlash[load.target.table] = load.values[0]  # written when it is switched on
            self._loaded(load)
            return
        wanted = _parameters_of(command, load.target)
        first = self._desk.settings.parameters_first
        if first:
            self._access.put_parameters(load.target, wanted)
        yield from self._put_points(load)
        if not first:
            self._access.put_parameters(load.target, wanted)
        yield self._desk.settings.scan_s
        if not self._desk.settings.careless:
            yield from self._compare(load, wanted)
        self._loaded(load)

    def _loaded(self, load: Load) -> None:
        self._desk.memory.half.discard(load.target.table)
        self._desk.load = None
        self._desk.loads_done += 1

    def _put_points(self, load: Load) -> Work:
        """Every point and zeros above them, so many in a cycle."""
        settings, reserved = self._desk.settings, self._access.reserved(load.target)
        values = (load.values + [0] * reserved)[:reserved]
        for place, value in enumerate(values):
            if place not in load.lost:
                self._access.put_point(load.target, place, self._coarse(value), float32=settings.float32_values)
            if place + 1 == self._desk.settings.power_cut_after:
                raise PlcPowerCut
            if place % settings.points_a_scan == settings.points_a_scan - 1:
                yield settings.scan_s

    def _coarse(self, value: int) -> int:
        quantum = self._desk.settings.quantum_points
        return round(value / quantum) * quantum if quantum else value

    def _compare(self, load: Load, wanted: Parameters) -> Work:
        """Read back from the NCK and compare. Raises PlcFault (10)."""
        a_scan, reserved = self._desk.settings.points_a_scan, self._access.reserved(load.target)
        values = (load.values + [0] * reserved)[:reserved]
        for first in range(0, reserved, a_scan):
            sent = values[first : first + a_scan]
            found = self._access.points(load.target, first, len(sent))
            for place, (old, new) in enumerate(zip(sent, found, strict=True), start=first):
                if self._coarse(old) != new and place not in load.lost:
                    raise PlcFault(DIFFERS, place)
            yield self._desk.settings.scan_s
        if self._access.parameters(load.target) != wanted:
            raise PlcFault(DIFFERS, PARAMETERS_DIFFER)

    def read_back(self, command: PlcCommand) -> Work:
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
        yield self._desk.settings.scan_s
        self._put_read_back(command, self._access.points(target, first, count))

    def _put_read_back(self, command: PlcCommand, values: list[int]) -> None:
        image = self._desk.image
        for place in range(r.MOST_POINTS):
            image.put_dint(r.READ_BACK + 2 * place, values[place] if place < len(values) else 0)
        crc = r.crc_of(command.head + tuple(image.words[r.READ_BACK : r.READ_BACK_CRC]))
        image.put_dint(r.READ_BACK_CRC, crc ^ self._desk.settings.wrong_read_back_crc)


def _parameters_of(command: PlcCommand, target: Target) -> Parameters:
    own = target.kind == EEC
    return Parameters(
        flags=command[r.FLAGS],
        minimum=command.minimum,
        step=command.step,
        maximum=command.maximum,
        input_axis=target.index if own else command[r.INPUT],
        output_axis=target.index if own else command[r.OUTPUT],
        factor=command[r.FACTOR],
    )
