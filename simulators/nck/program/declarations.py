"""DEF and PROC: a program's own variables, their initial values, and its parameters."""

from __future__ import annotations

from simulators.nck.language.syntax import Call, Define, Expression, Proc, ValueList
from simulators.nck.program.expressions import R_NAME, compiled
from simulators.nck.program.functions import FUNCTIONS
from simulators.nck.program.names import Names
from simulators.nck.program.procedures import PROCEDURES
from simulators.nck.program.scope import Frame, Variable
from simulators.nck.spec import NckRefusal
from simulators.nck.values import TEXT_MAX, whole

_RESERVED = frozenset({"R", "POS", "POSA", "AX", "MSG", "TRUE", "FALSE", *FUNCTIONS, *PROCEDURES})


class DeclaringNames(Names):
    """Names, and how a program adds its own."""

    def define(self, node: Define) -> None:
        """DEF. Raises NckRefusal 14500 after the first executable block."""
        frame = self._frames[-1]
        if frame.begun:
            raise NckRefusal(14500, "illegal DEF or PROC statement: stands behind executable blocks")
        length = whole(compiled(node.length)(self)) if node.length is not None else TEXT_MAX
        if not 1 <= length <= TEXT_MAX:
            raise NckRefusal(12160, "string length lies beyond the value range")
        for item in node.variables:
            self._check_free(item.name)
            sizes = tuple(whole(compiled(size)(self)) for size in item.dimensions)
            frame.define(item.name, node.kind, length, sizes)
            if item.initial is not None:
                self._initialise(item.name, item.initial)

    def _initialise(self, name: str, node: Expression) -> None:
        if isinstance(node, ValueList):
            self.fill(name, (), [compiled(item)(self) for item in node.items], repeat=False)
        elif isinstance(node, Call) and node.name in ("SET", "REP"):
            values = [compiled(item)(self) for item in node.arguments]
            self.fill(name, (), values, repeat=node.name == "REP")
        elif self._frames[-1].variables[name].dimensions:
            self.fill(name, (), [compiled(node)(self)], repeat=True)
        else:
            self.assign(name, (), compiled(node)(self))

    def _check_free(self, name: str) -> None:
        taken = self._core.axis_index(name) is not None or name in _RESERVED or R_NAME.fullmatch(name)
        address = len(name) == 1 and name in "DFGHLMST"
        if taken or address or len(name) > 31:
            raise NckRefusal(12170, f"name {name} already defined")

    def enter(self, node: Proc) -> None:
        """PROC: bind the parameters. Raises NckRefusal 12340."""
        frame = self._frames[-1]
        if frame.begun:
            raise NckRefusal(14500, "illegal DEF or PROC statement: stands behind executable blocks")
        if len(frame.arguments) > len(node.parameters):
            raise NckRefusal(12340, f"number of parameters of {node.name} too high")
        for place, parameter in enumerate(node.parameters):
            self._check_free(parameter.name)
            variable = frame.define(parameter.name, parameter.kind, TEXT_MAX, ())
            self._bind(frame, place, variable, parameter.default)
            setter = frame.setters[place] if place < len(frame.setters) else None
            if parameter.by_reference:
                if setter is None:
                    raise NckRefusal(12300, f"call-by-reference parameter {parameter.name} missing")
                frame.returns[parameter.name] = setter

    def _bind(self, frame: Frame, place: int, variable: Variable, default: Expression | None) -> None:
        if place < len(frame.arguments):
            variable.write((), frame.arguments[place])
        elif default is not None:
            variable.write((), compiled(default)(self))
