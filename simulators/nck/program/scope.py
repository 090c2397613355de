"""A program under execution: its local variables, and what names mean to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from simulators.nck.language.parser import Program
from simulators.nck.spec import NckRefusal
from simulators.nck.values import TEXT_MAX, Value, converted, initial, whole

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
        return cls(kind, length, dimensions, [initial(kind)] * count)

    def place(self, indices: tuple[Value, ...]) -> int:
        """Place of an element. Raises NckRefusal 12400, 17020, 17030."""
        if len(indices) != len(self.dimensions):
            raise NckRefusal(12400, "array element does not exist")
        place = 0
        for position, (index, size) in enumerate(zip(indices, self.dimensions, strict=True)):
            number = whole(index)
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
        self.values[place] = converted(self.kind, value, self.length)


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
