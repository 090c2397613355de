"""What names mean to the running program: legality, local variables, R, ``$`` variables, axes, calls, DEF and PROC.

Before a program's first block the printed rules of the language decide whether it runs (`drivers.sinumerik.legality`).
That checker knows neither this simulator nor the generators of programs, and it is all that the simulator shares with
them: so the simulator cannot be more lenient than the manuals.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

from drivers.sinumerik.legality import Finding, Machine, check
from simulators.nck.language.parser import outline_program
from simulators.nck.language.syntax import Call, Define, Expression, Indexed, Jump, Name, NcSyntaxError, Proc, ValueList
from simulators.nck.machine.core import Core
from simulators.nck.machine.files import program_path
from simulators.nck.program.block import TRANSFORMATIONS, BlockWords, Modal, is_silent
from simulators.nck.program.expressions import FUNCTIONS, R_NAME, Evaluate, compile_expression
from simulators.nck.program.procedures import PROCEDURES, Frame, Host, Variable, message_text
from simulators.nck.program.statements import Arguments, Step
from simulators.nck.program.variables import ProgramData, Variables, split_name
from simulators.nck.spec import NckRefusal, NckSpec
from simulators.nck.values import TEXT_MAX, AxisName, Value, convert, to_int

SYNTAX = 12080


def check_legality(spec: NckSpec, path: str, text: str, routines: frozenset[str]) -> None:
    """Judge a program before its first block; ``routines`` are names of other programs of the control.

    Raises NcSyntaxError (alarm 12080) with the line of the first rule that is broken.
    """
    if not spec.judges_programs:
        return
    axes = frozenset(name.upper() for axis in spec.axes for name in (axis.name, axis.letter))
    found = _first_violation(text, path.rpartition("/")[2], axes, routines)
    if found:
        raise NcSyntaxError(max(found[0].line, 1), f"{found[0].code}: {found[0].what}", SYNTAX)


@lru_cache(maxsize=32)
def _first_violation(text: str, name: str, axes: frozenset[str], routines: frozenset[str]) -> tuple[Finding, ...]:
    return check(text, name, Machine(axes, routines))


_DEPTH = 16
_TYPE_NUMBERS = {"BOOL": 1, "CHAR": 2, "INT": 3, "REAL": 4, "STRING": 5, "AXIS": 6}


class ControlPort(Host, Protocol):
    """What the interpreter asks of the control."""

    def block_done(self, run: object) -> bool:
        """Another block is done: what happens from outside at it; whether this run still exists."""
        ...

    def mains_fail_here(self) -> bool:
        """Count a block; whether the mains fail now."""
        ...

    def skips(self) -> bool:
        """Whether blocks marked / are skipped."""
        ...

    def stops_at_m1(self) -> bool:
        """Whether the optional stop is on."""
        ...


class NameResolver:
    """The levels of a running program and everything a block can refer to by name."""

    def __init__(self, core: Core, variables: Variables, panel: ControlPort, path: str, modal: Modal) -> None:
        self._core = core
        self._variables = variables
        self._panel = panel
        self._frames: list[Frame] = []
        self._steps: dict[str, dict[int, Step]] = {}
        self._line = 0
        self.said: str | None = None
        self._modal = modal
        self._data = ProgramData(core, lambda: [frame.path for frame in self._frames])
        self._push(path, ())

    # -- program levels ----------------------------------------------------------------------------

    def _push(self, path: str, arguments: tuple[Value, ...]) -> Frame:
        if len(self._frames) >= _DEPTH:
            raise NckRefusal(12540, "subprograms nested too deeply")
        text = self._panel.files.text(path)
        check_legality(self._core.spec, path, text, self._panel.files.routines)
        program = outline_program(text)
        self._steps[path] = {}
        frame = Frame(program, path, arguments=arguments)
        self._frames.append(frame)
        return frame

    def _return(self) -> None:
        frame = self._frames.pop()
        for name, hand_back in frame.returns.items():
            hand_back(frame.variables[name].values[0])

    def _call(self, name: str, arguments: tuple[Value, ...]) -> Frame:
        directory = self._frames[-1].directory
        for folder, kind in ((directory, "SPF"), (directory, "MPF"), ("/_N_SPF_DIR", "SPF")):
            path = program_path(f"{folder}/_N_{name}_{kind}", directory)
            if self._panel.files.exists(path):
                return self._push(path, arguments)
        raise NckRefusal(12550, f"name {name} not defined or option not available")

    # -- reading and assigning ---------------------------------------------------------------------

    def variable(self, name: str, indices: tuple[Value, ...]) -> Value:
        """The value of a name."""
        if name == "R":
            return self._variables.read("R", indices)
        local = self._frames[-1].variables.get(name)
        if local is not None:
            return local.read(indices)
        if self._data.knows(name):
            return self._data.read(name, indices)
        if name == "$P_EP":
            return self._programmed(indices)
        if name.startswith("$") or name in self._core.gud:
            return self._variables.read(name, indices)
        if not indices and self._core.axis_index(name) is not None:
            return AxisName(name)
        raise NckRefusal(12550, f"name {name} not defined or option not available")

    def _programmed(self, indices: tuple[Value, ...]) -> float:
        if len(indices) != 1 or not isinstance(indices[0], AxisName):
            raise NckRefusal(12400, "$P_EP: one index, an axis, is expected")
        axis = self._core.axis(indices[0])
        end = self._modal.planned.get(axis.index, axis.end_point)
        return axis.wrapped(end) / self._core.data.unit(axis.index)

    def assign(self, name: str, indices: tuple[Value, ...], value: Value) -> None:
        """Assign to a name."""
        local = self._frames[-1].variables.get(name)
        if local is not None:
            local.write(indices, value)
        elif self._data.knows(name):
            self._data.write(name, indices, value)
        elif name == "R" or name.startswith("$") or name in self._core.gud:
            self._variables.write(name, indices, value, self._core.access_level, program=True)
        else:
            raise NckRefusal(12550, f"name {name} not defined or option not available")

    def fill(self, name: str, places: tuple[Value, ...], values: list[Value], *, repeat: bool) -> None:
        """Assign a list (SET, REP) to an array from an element on, row by row; REP fills it to its end.

        Raises NckRefusal: 12550 (no array of that name, or a control that takes no lists), 12260 (too many values),
        and as `Variable.place`.
        """
        local = self._frames[-1].variables.get(name)
        if local is None or not self._core.spec.fills_arrays:
            raise NckRefusal(12550, f"name {name if local is None else 'SET'} not defined or option not available")
        begin = local.place(places) if places else 0
        room = len(local.values) - begin
        if repeat:
            values = values[:1] * room
        if len(values) > room:
            raise NckRefusal(12260, "too many initial values")
        local.values[begin : begin + len(values)] = [convert(local.kind, one, local.length) for one in values]

    def is_local(self, name: str) -> bool:
        """Whether a local variable of that name exists."""
        return name in self._frames[-1].variables

    def axis_of(self, name: str, indices: tuple[Value, ...]) -> int | None:
        """The axis a word on the left of ``=`` moves: X, X1, POS[X], AX[variable]."""
        if name in ("POS", "POSA", "AX") and len(indices) == 1 and isinstance(indices[0], AxisName):
            return self._core.axis(indices[0]).index
        return None if indices else self._core.axis_index(name)

    def function(self, name: str, given: tuple[Value, ...]) -> Value:
        """A function that needs the control."""
        first = given[0] if len(given) == 1 else None
        if name == "ISFILE" and isinstance(first, str):
            return self._panel.files.exists(program_path(first, self._frames[-1].directory))
        if name == "AXNAME" and isinstance(first, str):
            return AxisName(self._core.axis(first).spec.name)
        if name == "AXSTRING" and isinstance(first, AxisName):
            return str(first)
        if name == "ISVAR" and isinstance(first, str):
            return self._is_variable(first)
        if name == "GETVARTYP" and isinstance(first, str):
            local = self._frames[-1].variables.get(first.upper())
            return _TYPE_NUMBERS.get(local.kind, 0) if local is not None else 4 * self._is_variable(first)
        raise NckRefusal(12550, f"name {name} not defined or option not available")

    def _is_variable(self, text: str) -> bool:
        try:
            name, _ = split_name(text)
        except NckRefusal:
            return False
        return self.is_local(name) or self._data.knows(name) or self._variables.known(name)

    # -- words and calls ---------------------------------------------------------------------------

    def block_words(self) -> BlockWords:
        """An empty collection for a block."""
        return BlockWords(self._core, self._modal)

    def word(self, name: str) -> str:
        """A bare word; returns the ending it means, if any."""
        if name == "NEWCONF":
            if not self._core.spec.ignores_newconf:
                self._core.newconf()
        elif name == "RET":
            return "M17"
        elif not is_silent(name):
            self._call(name, ())
        return ""

    def procedure(self, name: str, arguments: tuple[Expression, ...], given: Arguments) -> None:
        """A call that stands alone."""
        frame = self._frames[-1]
        if name in TRANSFORMATIONS:
            self._modal.transformation = name
            return
        work = PROCEDURES.get(name)
        values = [self._passed(frame, node, value) for node, value in zip(arguments, given, strict=True)]
        if name == "MSG":
            self.said = message_text(values)
            return
        if work is not None:
            work(
                self._panel,
                frame,
                values,
                lambda place, value, element=None: self._hand_back(frame, arguments[place], value, element),
            )
            return
        called = self._call(name, tuple(values))
        called.setters = [self._setter(frame, node) for node in arguments]

    def _passed(self, frame: Frame, node: Expression, value: Evaluate) -> Value:
        if isinstance(node, Name) and node.name in frame.variables and frame.variables[node.name].dimensions:
            return 0
        return value(self)

    def _setter(self, frame: Frame, node: Expression) -> Callable[[Value], None] | None:
        if not isinstance(node, Name | Indexed):
            return None
        return lambda value: self._hand_back(frame, node, value, None)

    def _hand_back(self, frame: Frame, node: Expression, value: Value, element: int | None) -> None:
        if isinstance(node, Name) and node.name in frame.variables:
            frame.variables[node.name].write(() if element is None else (element,), value)
        elif isinstance(node, Name) and (found := R_NAME.fullmatch(node.name)):
            self._variables.write("R", (int(found[1]),), value, self._core.access_level, program=True)
        elif isinstance(node, Indexed) and (node.name == "R" or node.name in frame.variables):
            places = tuple(compile_expression(index)(self) for index in node.indices)
            self.assign(node.name, places, value)
        else:
            raise NckRefusal(12300, "call-by-reference parameter must be a variable")

    # -- going on ----------------------------------------------------------------------------------

    def jump(self, jump: Jump) -> None:
        """Go on at a label, or at the label a STRING variable names. Raises NckRefusal 14080."""
        frame = self._frames[-1]
        label = jump.label
        variable = frame.variables.get(label)
        if variable is not None and variable.kind == "STRING":
            label = str(variable.values[0]).upper()
        line = frame.program.find_label(jump.kind, label, self._line)
        if line is not None:
            frame.pc = line
        elif jump.kind != "GOTOC":
            raise NckRefusal(14080, f"jump destination {label} not found")

    def go(self, line: int) -> None:
        """Go on at a line."""
        self._frames[-1].pc = line

    def partner(self) -> int:
        """The line this line's structure leads to."""
        return self._frames[-1].program.partner[self._line]


# DEF and PROC: own variables with their initial values, and parameters.

_RESERVED = frozenset({"R", "POS", "POSA", "AX", "MSG", "TRUE", "FALSE", *FUNCTIONS, *PROCEDURES})


class DeclaringResolver(NameResolver):
    """Names, and how a program adds its own."""

    def define(self, node: Define) -> None:
        """DEF. Raises NckRefusal 14500 after the first executable block."""
        frame = self._frames[-1]
        if frame.begun:
            raise NckRefusal(14500, "illegal DEF or PROC statement: stands behind executable blocks")
        length = to_int(compile_expression(node.length)(self)) if node.length is not None else TEXT_MAX
        if not 1 <= length <= TEXT_MAX:
            raise NckRefusal(12160, "string length lies beyond the value range")
        for item in node.variables:
            self._check_free(item.name)
            sizes = tuple(to_int(compile_expression(size)(self)) for size in item.dimensions)
            frame.define(item.name, node.kind, length, sizes)
            if item.initial is not None:
                self._initialise(item.name, item.initial)

    def _initialise(self, name: str, node: Expression) -> None:
        if isinstance(node, ValueList):
            self.fill(name, (), [compile_expression(item)(self) for item in node.items], repeat=False)
        elif isinstance(node, Call) and node.name in ("SET", "REP"):
            values = [compile_expression(item)(self) for item in node.arguments]
            self.fill(name, (), values, repeat=node.name == "REP")
        elif self._frames[-1].variables[name].dimensions:
            self.fill(name, (), [compile_expression(node)(self)], repeat=True)
        else:
            self.assign(name, (), compile_expression(node)(self))

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
            variable.write((), compile_expression(default)(self))
