"""A program level with its variables, and the built-in calls: MSG, WRITE, READ, DELETE, FILESIZE, SETAL, WAITP."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from simulators.nck.language.parser import Program
from simulators.nck.machine.data import AlarmList
from simulators.nck.machine.files import NO_FILE, OK, OTHER, FileSystem, program_path
from simulators.nck.spec import NckRefusal
from simulators.nck.values import TEXT_MAX, AxisName, Value, convert, format_value, initial_value, to_int

KINDS = frozenset({"INT", "REAL", "BOOL", "CHAR", "STRING", "AXIS"})
_LARGEST_ARRAY = 100_000


@dataclass(slots=True)
class Variable:
    """A local variable; arrays are kept flat, row by row."""

    kind: str
    length: int
    dimensions: tuple[int, ...]
    values: list[Value]

    @classmethod
    def fresh(cls, kind: str, length: int, dimensions: tuple[int, ...]) -> Variable:
        """A new variable. Raises NckRefusal 12160 for dimensions that cannot be."""
        count = 1
        for size in dimensions:
            count *= size
        if any(size < 1 for size in dimensions) or count > _LARGEST_ARRAY or len(dimensions) > 3:
            raise NckRefusal(12190, "array dimensions not possible")
        return cls(kind, length, dimensions, [initial_value(kind)] * count)

    def place(self, indices: tuple[Value, ...]) -> int:
        """Place of an element. Raises NckRefusal 12400, 17020, 17030."""
        if len(indices) != len(self.dimensions):
            raise NckRefusal(12400, "array element does not exist")
        place = 0
        for position, (index, size) in enumerate(zip(indices, self.dimensions, strict=True)):
            number = to_int(index)
            if not 0 <= number < size:
                raise NckRefusal(17020 if position == 0 else 17030, f"illegal array index {position + 1}")
            place = place * size + number
        return place

    def read(self, indices: tuple[Value, ...]) -> Value:
        """The value, or an element's."""
        return self.values[self.place(indices)] if indices or self.dimensions else self.values[0]

    def write(self, indices: tuple[Value, ...], value: Value) -> None:
        """Assign with conversion to the variable's type."""
        place = self.place(indices) if indices or self.dimensions else 0
        self.values[place] = convert(self.kind, value, self.length)


@dataclass(slots=True)
class Frame:
    """One level of program: where it is and what it knows."""

    program: Program
    path: str
    pc: int = 0
    begun: bool = False
    variables: dict[str, Variable] = field(default_factory=dict)
    arguments: tuple[Value, ...] = ()
    setters: list[Callable[[Value], None] | None] = field(default_factory=list)
    returns: dict[str, Callable[[Value], None]] = field(default_factory=dict)

    @property
    def directory(self) -> str:
        """Directory of the running program."""
        return self.path.rpartition("/")[0]

    @property
    def name(self) -> str:
        """Program name as the control shows it."""
        return self.path.rpartition("/")[2]

    def define(self, name: str, kind: str, length: int, dimensions: tuple[int, ...]) -> Variable:
        """Create a local variable. Raises NckRefusal 12170 for a name in use, 12080 for an unknown type."""
        if kind not in KINDS:
            raise NckRefusal(12080, f"syntax error: {kind} is no type")
        if name in self.variables:
            raise NckRefusal(12170, f"name {name} already defined")
        variable = Variable.fresh(kind, length if kind == "STRING" else TEXT_MAX, dimensions)
        self.variables[name] = variable
        return variable


# Built-in calls.


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


class StoreResult(Protocol):
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


def message_text(given: list[Value]) -> str:
    """What MSG is to show. Raises NckRefusal 12340."""
    _count("MSG", given, 0, 2)
    return format_value(given[0]) if given else ""


def _write(host: Host, frame: Frame, given: list[Value], store: StoreResult) -> None:
    _count("WRITE", given, 3, 3)
    text = format_value(given[2])
    if len(text) > TEXT_MAX:
        store(0, OTHER)
        return
    path = program_path(_text(given[1]), frame.directory)
    store(0, host.files.append(path, text, host.file_limit()))


def _delete(host: Host, frame: Frame, given: list[Value], store: StoreResult) -> None:
    _count("DELETE", given, 2, 2)
    store(0, host.files.remove(program_path(_text(given[1]), frame.directory)))


def _filesize(host: Host, frame: Frame, given: list[Value], store: StoreResult) -> None:
    _count("FILESIZE", given, 3, 3)
    path = program_path(_text(given[1]), frame.directory)
    there = host.files.exists(path)
    store(0, OK if there else host.files.state_of_path(path) or NO_FILE)
    store(2, host.files.size(path) if there else 0)


def _read(host: Host, frame: Frame, given: list[Value], store: StoreResult) -> None:
    _count("READ", given, 5, 5)
    path = program_path(_text(given[1]), frame.directory)
    if not host.files.exists(path):
        store(0, host.files.state_of_path(path) or NO_FILE)
        return
    lines = host.files.text(path).splitlines()
    first, count = to_int(given[2]), to_int(given[3])
    wanted = lines[max(first - 1, 0) : max(first - 1, 0) + max(count, 0)]
    if first < 1 or len(wanted) < count:
        store(0, 21)
        return
    for place, line in enumerate(wanted):
        store(4, line[:TEXT_MAX], place)
    store(0, OK)


def _setal(host: Host, _frame: Frame, given: list[Value], _store: StoreResult) -> None:
    _count("SETAL", given, 1, 2)
    number = to_int(given[0])
    if not 60000 <= number <= 69999:
        raise NckRefusal(14092, f"SETAL: {number} is no user alarm")
    text = format_value(given[1]) if len(given) > 1 else f"user alarm {number}"
    if number < 62000:
        raise NckRefusal(number, text)
    host.alarms_list.raise_(number, text)


def _nothing(_host: Host, _frame: Frame, _given: list[Value], _store: StoreResult) -> None:
    """Understood, and without effect here: axes always wait for each other."""


PROCEDURES: dict[str, Callable[[Host, Frame, list[Value], StoreResult], None]] = {
    "WRITE": _write,
    "DELETE": _delete,
    "FILESIZE": _filesize,
    "READ": _read,
    "SETAL": _setal,
    "WAITP": _nothing,
}
