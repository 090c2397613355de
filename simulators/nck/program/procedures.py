"""Built-in calls that stand alone: MSG's text, WRITE, READ, DELETE, FILESIZE, SETAL, WAITP."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from simulators.nck.machine.alarms import AlarmList
from simulators.nck.machine.files import NO_FILE, OK, OTHER, FileSystem, program_path
from simulators.nck.program.scope import Frame
from simulators.nck.spec import NckRefusal
from simulators.nck.values import TEXT_MAX, AxisName, Value, readable, whole


class Host(Protocol):
    """What the built-in calls need of the control."""

    @property
    def files(self) -> FileSystem:
        """The file system."""
        ...

    @property
    def alarms_list(self) -> AlarmList:
        """The alarms standing."""
        ...

    def show(self, text: str) -> None:
        """Show a message of the part program."""
        ...

    def file_limit(self) -> int:
        """Bytes a written file may grow to (MD11420)."""
        ...


class HandsBack(Protocol):
    """Hands a value back to the caller's variable at a parameter's place."""

    def __call__(self, place: int, value: Value, element: int | None = None) -> None:
        """Store; ``element`` for an array."""
        ...


def _text(value: Value) -> str:
    if not isinstance(value, str) or isinstance(value, AxisName):
        raise NckRefusal(12330, "type of parameter 2 incorrect: text is expected")
    return value


def _count(name: str, given: list[Value], fewest: int, most: int) -> None:
    if not fewest <= len(given) <= most:
        raise NckRefusal(12340, f"number of parameters of {name} incorrect")


def message_of(given: list[Value]) -> str:
    """What MSG is to show. Raises NckRefusal 12340."""
    _count("MSG", given, 0, 2)
    return readable(given[0]) if given else ""


def _write(host: Host, frame: Frame, given: list[Value], store: HandsBack) -> None:
    _count("WRITE", given, 3, 3)
    text = readable(given[2])
    if len(text) > TEXT_MAX:
        store(0, OTHER)
        return
    path = program_path(_text(given[1]), frame.directory)
    store(0, host.files.append(path, text, host.file_limit()))


def _delete(host: Host, frame: Frame, given: list[Value], store: HandsBack) -> None:
    _count("DELETE", given, 2, 2)
    store(0, host.files.remove(program_path(_text(given[1]), frame.directory)))


def _filesize(host: Host, frame: Frame, given: list[Value], store: HandsBack) -> None:
    _count("FILESIZE", given, 3, 3)
    path = program_path(_text(given[1]), frame.directory)
    there = host.files.exists(path)
    store(0, OK if there else host.files.state_of_path(path) or NO_FILE)
    store(2, host.files.size(path) if there else 0)


def _read(host: Host, frame: Frame, given: list[Value], store: HandsBack) -> None:
    _count("READ", given, 5, 5)
    path = program_path(_text(given[1]), frame.directory)
    if not host.files.exists(path):
        store(0, host.files.state_of_path(path) or NO_FILE)
        return
    lines = host.files.text(path).splitlines()
    first, count = whole(given[2]), whole(given[3])
    wanted = lines[max(first - 1, 0) : max(first - 1, 0) + max(count, 0)]
    if first < 1 or len(wanted) < count:
        store(0, 21)
        return
    for place, line in enumerate(wanted):
        store(4, line[:TEXT_MAX], place)
    store(0, OK)


def _setal(host: Host, _frame: Frame, given: list[Value], _store: HandsBack) -> None:
    _count("SETAL", given, 1, 2)
    number = whole(given[0])
    if not 60000 <= number <= 69999:
        raise NckRefusal(14092, f"SETAL: {number} is no user alarm")
    text = readable(given[1]) if len(given) > 1 else f"user alarm {number}"
    if number < 62000:
        raise NckRefusal(number, text)
    host.alarms_list.raise_(number, text)


def _nothing(_host: Host, _frame: Frame, _given: list[Value], _store: HandsBack) -> None:
    """Understood, and without effect here: axes always wait for each other."""


PROCEDURES: dict[str, Callable[[Host, Frame, list[Value], HandsBack], None]] = {
    "WRITE": _write,
    "DELETE": _delete,
    "FILESIZE": _filesize,
    "READ": _read,
    "SETAL": _setal,
    "WAITP": _nothing,
}
