"""The mailbox's commands: number, check sum, session and order first, then the command's own work."""

from __future__ import annotations

from collections.abc import Callable

from simulators.modbus import registers as r
from simulators.modbus.access import NckAccess
from simulators.modbus.checks import Checks
from simulators.modbus.loading import Loading
from simulators.modbus.plcstate import PlcDesk, Work
from simulators.modbus.registers import PlcCommand
from simulators.modbus.switching import LOOK_S, PlcSwitching
from simulators.modbus.target import (
    BACKLASH_KIND,
    CEC,
    EEC,
    NCK_REFUSED,
    NO_CRC,
    NO_SESSION,
    NOT_IN_RESET,
    NOT_RELEASED,
    OUT_OF_ORDER,
    RANGE,
    TAKEN,
    TEMPERATURE,
    UNKNOWN,
    PlcFault,
    Target,
)

OPEN, BEGIN, CHUNK, VERIFY, ACTIVATE, DISABLE, READ_BACK, ABORT, CLOSE, SET_MARKER, SELECT = range(1, 12)
SELECTING = frozenset({BEGIN, CHUNK, VERIFY, READ_BACK, SELECT})
WITH_DATA = frozenset({CHUNK, ACTIVATE, DISABLE, SET_MARKER})
_WITHOUT_SESSION = frozenset({OPEN, SELECT})
_ALARM = 700016  # a user alarm of the PLC


class PlcCommands:
    """Checks and does commands at one desk."""

    def __init__(self, desk: PlcDesk, access: NckAccess) -> None:
        self._desk = desk
        self._access = access
        self.checks = Checks(desk, access)
        loading = Loading(desk, access, self.checks)
        self._switching = switching = PlcSwitching(desk, access, self.checks)
        self._works: dict[int, Callable[[PlcCommand], Work]] = {
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

    def work(self, command: PlcCommand, expected: int, *, busy: bool) -> Work:
        """One command with all its checks; ``busy``: another one was under way."""
        code = command[r.COMMAND]
        if command[r.NUMBER] != expected:
            raise PlcFault(OUT_OF_ORDER, expected)
        if r.crc_of(self._covered(command)) != command.crc:
            raise PlcFault(NO_CRC)
        if code not in self._works:
            raise PlcFault(UNKNOWN)
        self._check_session(code)
        if (busy and code not in (ABORT, CLOSE)) or (code in (CHUNK, VERIFY) and self._desk.load is None):
            raise PlcFault(OUT_OF_ORDER, expected)
        yield from self._troubled(code)
        yield from self._works[code](command)

    def selected_by(self, command: PlcCommand) -> Target | None:
        """What a command that was done selects: the table that it named, the last one of several, or nothing."""
        code = command[r.COMMAND]
        if code in (ACTIVATE, DISABLE):
            return self._switching.entries(command)[-1].target
        return self.checks.target(command, (command[r.KIND],)) if code in SELECTING else None

    def _covered(self, command: PlcCommand) -> tuple[int, ...]:
        code = command[r.COMMAND]
        if code in WITH_DATA:
            return command.head + command.data
        load = self._desk.load
        return command.head + tuple(load.words) if code == VERIFY and load is not None else command.head

    def _check_session(self, code: int) -> None:
        session = self._desk.session
        if code == OPEN and session:
            raise PlcFault(TAKEN, session)
        if code not in _WITHOUT_SESSION and not session:
            raise PlcFault(NO_SESSION)

    def _troubled(self, code: int) -> Work:
        settings = self._desk.settings
        if settings.alarm_during == code:
            self._access.nck.drive_alarm(_ALARM, "PLC: coolant level low")
        if settings.nck_refuses == code:
            raise PlcFault(NCK_REFUSED, settings.nck_result)
        if settings.enables_itself == code:
            self._access.nck.enable_by_itself()
        if settings.forgets == code:
            self._desk.forget(settings.forgets_what)
        while self._desk.settings.busy_forever == code:
            yield LOOK_S

    # -- session, marker, selection ----------------------------------------------------------------

    def _open(self, command: PlcCommand) -> Work:
        if not command[r.INDEX]:
            raise PlcFault(RANGE, r.INDEX)
        self._desk.open_session(command[r.INDEX])
        yield from ()

    def _abort(self, _command: PlcCommand) -> Work:
        self._desk.load = None
        yield from ()

    def _close(self, _command: PlcCommand) -> Work:
        self._desk.close_session()
        yield from ()

    def _set_marker(self, command: PlcCommand) -> Work:
        state = command.data[8]
        if state > 3:
            raise PlcFault(RANGE, r.DATA + 8)
        if not self._desk.release.was_given:
            raise PlcFault(NOT_RELEASED)
        self._desk.memory.marker = command.data[:8]
        self._desk.memory.marker_state = state
        self._desk.memory.marker_head = command.data[9:13]
        yield from ()

    def _select(self, command: PlcCommand) -> Work:
        self.checks.target(command, (EEC, CEC, BACKLASH_KIND, TEMPERATURE))
        if not self._access.ready:
            raise PlcFault(NOT_IN_RESET)
        yield from ()
