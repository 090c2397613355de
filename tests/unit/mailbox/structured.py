"""Reads and runs the subset of IEC 61131-3 structured text that docs/plc is written in, apart from any PLC.

Stricter than most compilers, so that none of them has to guess: every name declared before it is used, every type
named, no conversion that is not written down, no number that leaves its type, no index outside its array, no reserved
word as a name. AND and OR work out both sides. The text becomes Python functions; what it says is all that they do.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

_TOKEN = re.compile(
    r"(?P<blank>\s+|\(\*.*?\*\))|(?P<number>16#[0-9A-F]+|T#\d+(?:ms|s)\b|\d+)|(?P<name>[A-Za-z]\w*)"
    r"|(?P<sign>:=|<>|<=|>=|\.\.|[-+*/()\[\],;:=<>.])",
    re.DOTALL,
)
_WORDS = """
ABS ACTION AND ANY ARRAY AT BOOL BY BYTE CASE CONFIGURATION CONSTANT CONTINUE CTD CTU CTUD DATE DINT DO DWORD ELSE
ELSIF EN END_CASE END_FOR END_FUNCTION END_FUNCTION_BLOCK END_IF END_REPEAT END_STRUCT END_TYPE END_VAR END_WHILE
ENO EXIT FALSE FOR FROM FUNCTION FUNCTION_BLOCK F_EDGE F_TRIG IF INITIAL_STEP INT INTERVAL LEFT LEN LIMIT LINT LREAL
LWORD MAX MID MIN MOD MUX NOT OF ON OR PRIORITY PROGRAM READ_ONLY READ_WRITE REAL REPEAT REPLACE RESOURCE RETAIN
RETURN RIGHT ROL ROR RS R_EDGE R_TRIG SEL SHL SHR SINGLE SINT SR STEP STRING STRUCT TASK THEN TIME TO TOD TOF TON TP
TRANSITION TRUE TYPE UDINT UINT ULINT UNTIL USINT VAR VAR_ACCESS VAR_EXTERNAL VAR_GLOBAL VAR_INPUT VAR_IN_OUT
VAR_OUTPUT WHILE WITH WORD WSTRING XOR
"""
RESERVED = frozenset(_WORDS.split())
RANGES = {
    "BOOL": (0, 1),
    "WORD": (0, 0xFFFF),
    "DWORD": (0, 0xFFFFFFFF),
    "INT": (-(1 << 15), (1 << 15) - 1),
    "UINT": (0, 0xFFFF),
    "DINT": (-(1 << 31), (1 << 31) - 1),
    "LINT": (-(1 << 63), (1 << 63) - 1),
    "TIME": (0, (1 << 31) - 1),
}
_BITS = ("WORD", "DWORD")
_NUMBERS = ("INT", "UINT", "DINT", "LINT")
_LEVELS = (("OR",), ("XOR",), ("AND",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"), ("*",))
_PYTHON = {"OR": "|", "XOR": "^", "AND": "&", "=": "==", "<>": "!="}
_SECTIONS = ("VAR", "VAR_INPUT", "VAR_IN_OUT")
LITERAL = "a number"


class Unsound(Exception):
    """The text breaks a rule of the standard, or leaves the subset."""


class LeftItsType(Exception):
    """While it ran, a number left its type or an index its array."""


@dataclass(frozen=True)
class Kind:
    """A type. ``name`` as declared; arrays have bounds and an element, structures fields."""

    name: str
    first: int = 0
    last: int = -1
    element: str = ""
    fields: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Variable:
    """A declared name: its section, type and what stands for it in Python."""

    name: str
    section: str
    kind: str
    python: str
    initial: int = 0
    constant: bool = False
    retain: bool = False


@dataclass
class Unit:
    """A function or function block, translated."""

    name: str
    kind: str
    variables: dict[str, Variable]
    run: Callable[..., Any] | None = None

    def of(self, section: str) -> list[Variable]:
        """Its variables of one section, in order."""
        return [one for one in self.variables.values() if one.section == section and not one.constant]


class OnDelay:
    """TON of the standard. Times in ms."""

    def __init__(self) -> None:
        self.Q = False
        self.ET = 0
        self._since: int | None = None

    def step(self, now: int, IN: bool, PT: int) -> None:
        """One call in a cycle."""
        self._since = (now if self._since is None else self._since) if IN else None
        self.ET = 0 if self._since is None else min(now - self._since, PT)
        self.Q = self._since is not None and now - self._since >= PT


class Record:
    """A structure's or a block's memory."""


def _kept(value: int, low: int, high: int) -> int:
    if not low <= value <= high:
        raise LeftItsType(f"{value} is outside {low}..{high}")
    return value


def _at(index: int, first: int, last: int) -> int:
    if not first <= index <= last:
        raise LeftItsType(f"index {index} is outside {first}..{last}")
    return index - first


def bounded(value: int, kind: str) -> int:
    """The bits of a number as a type holds them."""
    low, high = RANGES[kind]
    value &= high - low
    return value - (high - low + 1) if value > high else value


def tokens(text: str) -> Iterator[tuple[str, int]]:
    """Words and signs with their lines; comments are gone. Raises Unsound."""
    at = 0
    while at < len(text):
        found = _TOKEN.match(text, at)
        if found is None:
            raise Unsound(f"line {text.count(chr(10), 0, at) + 1}: nothing of the language begins with {text[at]!r}")
        if found.lastgroup != "blank":
            yield found[0], text.count("\n", 0, at) + 1
        at = found.end()


class Library:
    """Types, functions and function blocks of some files, ready to run. Raises Unsound."""

    def __init__(self, *files: Path, texts: tuple[str, ...] = ()) -> None:
        self.types: dict[str, Kind] = {name: Kind(name) for name in (*RANGES, "TON")}
        self.members: dict[str, tuple[str, int]] = {}
        self.units: dict[str, Unit] = {}
        self.space: dict[str, Any] = {"_kept": _kept, "_at": _at, "_bits": bounded}
        for text in (*(file.read_text(encoding="utf-8") for file in files), *texts):
            _Reader(text, self).all()

    def call(self, name: str, given: Mapping[str, Any]) -> Any:
        """What a function gives for named arguments."""
        return cast(Any, self.units[name.upper()].run)(**given)

    def made(self, kind: str) -> Any:
        """A variable of a type as it is at first."""
        found = self.types[kind]
        if found.element:
            return [self.made(found.element) for _ in range(found.first, found.last + 1)]
        if found.fields:
            made = Record()
            for name, of in found.fields.values():
                setattr(made, name, self.made(of))
            return made
        return OnDelay() if kind == "TON" else False if kind == "BOOL" else 0

    def block(self, name: str, retained: Mapping[str, Any] | None = None) -> Record:
        """The memory of a function block at a start; ``retained`` is kept from before."""
        made = Record()
        for one in self.units[name.upper()].of("VAR"):
            kept = one.retain and retained is not None
            setattr(made, one.name, cast(Any, retained)[one.name] if kept else self.made(one.kind) or one.initial)
        return made

    def retained(self, name: str, memory: Record) -> dict[str, Any]:
        """What of a block's memory outlives a power cut."""
        return {one.name: getattr(memory, one.name) for one in self.units[name.upper()].of("VAR") if one.retain}

    def cycle(self, name: str, memory: Record, now_ms: int, given: Mapping[str, Any]) -> None:
        """One call of a function block."""
        cast(Any, self.units[name.upper()].run)(memory, now_ms, **given)


class _Reader:
    """One file: recursive descent over its tokens, translating as it goes."""

    def __init__(self, text: str, library: Library) -> None:
        self._tokens = list(tokens(text))
        self._at = 0
        self._library = library
        self._scope: dict[str, Variable] = {}
        self._lines: list[str] = []
        self._depth = 1

    # ---- tokens -----------------------------------------------------------------------------------

    def _next(self, ahead: int = 0) -> str:
        at = self._at + ahead
        return self._tokens[at][0] if at < len(self._tokens) else ""

    def _fault(self, why: str) -> Unsound:
        line = self._tokens[min(self._at, len(self._tokens) - 1)][1]
        return Unsound(f"line {line}: {why}")

    def _take(self, *wanted: str) -> str:
        token = self._next()
        if not token or (wanted and token not in wanted):
            raise self._fault(f"{' or '.join(wanted) or 'more'} expected, {token or 'the end'} found")
        self._at += 1
        return token

    def _is(self, *wanted: str) -> bool:
        if self._next() in wanted:
            self._at += 1
            return True
        return False

    def _new_name(self) -> str:
        name = self._take()
        if not name[0].isalpha() or name.upper() in RESERVED:
            raise self._fault(f"{name} is no name")
        return name

    def _whole(self) -> int:
        negative = self._is("-")
        token = self._take()
        if not token[0].isdigit():
            raise self._fault(f"{token} is no number")
        number = int(token[3:], 16) if token.startswith("16#") else int(token)
        return -number if negative else number

    # ---- declarations -----------------------------------------------------------------------------

    def all(self) -> None:
        """Everything in the file."""
        while self._next():
            {"TYPE": self._types, "FUNCTION": self._unit, "FUNCTION_BLOCK": self._unit}.get(
                self._next(), self._no_unit
            )()

    def _no_unit(self) -> None:
        raise self._fault(f"{self._next()} stands outside every unit")

    def _types(self) -> None:
        self._take("TYPE")
        name = self._new_name()
        self._take(":")
        if name in self._library.types or name.upper() in self._library.units:
            raise self._fault(f"{name} is declared twice")
        made = {"ARRAY": self._array, "STRUCT": self._struct, "(": self._enumeration}.get(self._next())
        if made is None:
            raise self._fault("an array, a structure or a list of values expected")
        self._library.types[name] = made(name)
        self._take(";")
        self._take("END_TYPE")

    def _array(self, name: str) -> Kind:
        self._take("ARRAY")
        self._take("[")
        first = self._whole()
        self._take("..")
        last = self._whole()
        self._take("]")
        self._take("OF")
        return Kind(name, first, last, self._type())

    def _struct(self, name: str) -> Kind:
        self._take("STRUCT")
        fields: dict[str, tuple[str, str]] = {}
        while not self._is("END_STRUCT"):
            one = self._new_name()
            self._take(":")
            if one.upper() in fields:
                raise self._fault(f"{one} is declared twice")
            fields[one.upper()] = (one, self._type())
            self._take(";")
        return Kind(name, fields=fields)

    def _enumeration(self, name: str) -> Kind:
        self._take("(")
        values = [self._new_name()]
        while self._is(","):
            values.append(self._new_name())
        self._take(")")
        for place, one in enumerate(values):
            if one.upper() in self._library.members:
                raise self._fault(f"{one} is declared twice")
            self._library.members[one.upper()] = (name, place)
        return Kind(name, values=tuple(values))

    def _type(self) -> str:
        name = self._take()
        if name not in self._library.types:
            raise self._fault(f"no type {name} is known here")
        return name

    def _unit(self) -> None:
        block = self._take() == "FUNCTION_BLOCK"
        name = self._new_name()
        kind = ""
        if not block:
            self._take(":")
            kind = self._type()
        if name.upper() in self._library.units or name in self._library.types:
            raise self._fault(f"{name} is declared twice")
        self._scope = {} if block else {name.upper(): Variable(name, "RESULT", kind, "result")}
        while self._next() in _SECTIONS:
            self._section(self._take(), block)
        unit = Unit(name, kind, self._scope)
        self._lines, self._depth = [], 1
        self._steps("END_FUNCTION_BLOCK" if block else "END_FUNCTION")
        self._take()
        self._translate(unit, block)
        self._library.units[name.upper()] = unit

    def _section(self, section: str, block: bool) -> None:
        word = self._take() if section == "VAR" and self._next() in ("CONSTANT", "RETAIN") else ""
        while not self._is("END_VAR"):
            name = self._new_name()
            self._take(":")
            kind = self._type()
            initial = self._initial(kind) if self._is(":=") else None
            self._take(";")
            if name.upper() in self._scope or name.upper() in self._library.members:
                raise self._fault(f"{name} is declared twice")
            if (word == "CONSTANT") != (initial is not None):
                raise self._fault(f"{name}: a constant has a value, nothing else here has one")
            python = str(initial) if word == "CONSTANT" else f"s.{name}" if block and section == "VAR" else f"v_{name}"
            self._scope[name.upper()] = Variable(
                name, section, kind, python, initial or 0, constant=word == "CONSTANT", retain=word == "RETAIN"
            )

    def _initial(self, kind: str) -> int:
        if kind == "TIME":
            return self._time(self._take())
        value = self._whole()
        if not RANGES[kind][0] <= value <= RANGES[kind][1]:
            raise self._fault(f"{value} is no {kind}")
        return value

    def _time(self, token: str) -> int:
        found = re.fullmatch(r"T#(\d+)(ms|s)", token)
        if found is None:
            raise self._fault(f"{token} is no time")
        return int(found[1]) * (1000 if found[2] == "s" else 1)

    def _translate(self, unit: Unit, block: bool) -> None:
        given = [one.python for section in ("VAR_INPUT", "VAR_IN_OUT") for one in unit.of(section)]
        head = ", ".join(one.removeprefix("v_") for one in given)
        lines = [f"def run({'s, now, ' if block else ''}{head}):"]
        lines += [f"    {one} = {one.removeprefix('v_')}" for one in given]
        if not block:
            names = [one.python for one in unit.of("VAR")]
            lines += [f"    {name} = 0" for name in ("result", *names)]
        lines += [*self._lines, "    return None" if block else "    return result"]
        made: dict[str, Any] = {}
        exec(compile("\n".join(lines), unit.name, "exec"), self._library.space, made)  # noqa: S102 - of the text alone
        unit.run = made["run"]
        if not block:
            self._library.space[f"f_{unit.name}"] = unit.run

    # ---- statements -------------------------------------------------------------------------------

    def _put(self, line: str) -> None:
        self._lines.append("    " * self._depth + line)

    def _inside(self, *ends: str) -> None:
        self._depth += 1
        self._steps(*ends)
        self._depth -= 1

    def _steps(self, *ends: str) -> None:
        self._put("pass")
        while self._next() not in ends:
            if self._is(";"):
                continue
            acts = {"IF": self._if, "FOR": self._for, "WHILE": self._while, "CASE": self._case}
            acts.get(self._next(), self._other)()
            self._take(";")

    def _condition(self) -> str:
        text, kind = self._term()
        if kind != "BOOL":
            raise self._fault(f"a condition is no {kind}")
        return text

    def _if(self) -> None:
        self._take("IF")
        self._put(f"if {self._condition()}:")
        self._take("THEN")
        self._inside("ELSIF", "ELSE", "END_IF")
        while self._is("ELSIF"):
            self._put(f"elif {self._condition()}:")
            self._take("THEN")
            self._inside("ELSIF", "ELSE", "END_IF")
        if self._is("ELSE"):
            self._put("else:")
            self._inside("END_IF")
        self._take("END_IF")

    def _for(self) -> None:
        self._take("FOR")
        target, kind = self._place(writing=True)
        self._take(":=")
        first = self._as(kind)
        self._take("TO")
        last = self._as(kind)
        self._take("DO")
        self._put(f"for {target} in range({first}, {last} + 1):")
        self._inside("END_FOR")
        self._take("END_FOR")

    def _while(self) -> None:
        self._take("WHILE")
        self._put(f"while {self._condition()}:")
        self._take("DO")
        self._inside("END_WHILE")
        self._take("END_WHILE")

    def _case(self) -> None:
        self._take("CASE")
        text, kind = self._term()
        if kind not in _NUMBERS:
            raise self._fault(f"CASE asks for a number, not for {kind}")
        self._take("OF")
        self._put(f"case = {text}")
        word = "if"
        while self._next() not in ("ELSE", "END_CASE"):
            self._put(f"{word} case == {self._whole()}:")
            self._take(":")
            self._branch()
            word = "elif"
        if self._is("ELSE"):
            self._put("else:")
            self._inside("END_CASE")
        self._take("END_CASE")

    def _branch(self) -> None:
        """Statements up to the next number of a CASE."""
        self._depth += 1
        self._put("pass")
        while self._next() not in ("ELSE", "END_CASE") and not (self._next()[0].isdigit() and self._next(1) == ":"):
            acts = {"IF": self._if, "FOR": self._for, "WHILE": self._while}
            acts.get(self._next(), self._other)()
            self._take(";")
        self._depth -= 1

    def _other(self) -> None:
        """An assignment, or the call of a timer."""
        target, kind = self._place(writing=True)
        if kind == "TON":
            self._take("(")
            given = self._arguments({"IN": "BOOL", "PT": "TIME"})
            self._put(f"{target}.step(now, {given})")
            return
        if kind not in RANGES and not self._library.types[kind].values:
            raise self._fault(f"nothing whole of type {kind} is assigned here")
        self._take(":=")
        self._put(f"{target} = {self._as(kind)}")

    # ---- expressions ------------------------------------------------------------------------------

    def _as(self, kind: str) -> str:
        """An expression that has this type, or is a number that fits it."""
        text, found = self._term()
        return self._fitted(text, found, kind)

    def _fitted(self, text: str, found: str, kind: str) -> str:
        if found == LITERAL and kind in (*_NUMBERS, *_BITS):
            if not RANGES[kind][0] <= int(text) <= RANGES[kind][1]:
                raise self._fault(f"{text} is no {kind}")
            return text
        if found != kind:
            raise self._fault(f"{kind} expected, {found} found")
        return text

    def _term(self, level: int = 0) -> tuple[str, str]:
        """An expression in Python and its type; the weakest operators first."""
        if level == len(_LEVELS):
            return self._factor()
        left = self._term(level + 1)
        while self._next() in _LEVELS[level]:
            left = self._both(self._take(), left, self._term(level + 1))
        return left

    def _both(self, sign: str, left: tuple[str, str], right: tuple[str, str]) -> tuple[str, str]:
        kind = left[1] if left[1] != LITERAL else right[1]
        one, other = (self._fitted(*part, kind) if kind != LITERAL else part[0] for part in (left, right))
        text = f"({one} {_PYTHON.get(sign, sign)} {other})"
        if sign in ("OR", "XOR", "AND"):
            allowed, result = ("BOOL", *_BITS), kind
        elif sign in ("=", "<>"):
            listed = tuple(name for name, one in self._library.types.items() if one.values)
            allowed, result = ("BOOL", *_BITS, *_NUMBERS, *listed), "BOOL"
        elif sign in ("<", ">", "<=", ">="):
            allowed, result = (*_BITS, *_NUMBERS), "BOOL"
        else:
            allowed, result = _NUMBERS, kind
        if kind not in allowed:
            raise self._fault(f"{sign} does not go with {kind}")
        if result in _NUMBERS:
            text = f"_kept({text}, {RANGES[kind][0]}, {RANGES[kind][1]})"
        return text, result

    def _factor(self) -> tuple[str, str]:
        if self._is("("):
            text, kind = self._term()
            self._take(")")
            return text, kind
        if self._is("-"):
            text, kind = self._factor()
            if kind != LITERAL:
                raise self._fault("only a number is made negative here")
            return f"-{text}", kind
        if self._is("NOT"):
            text, kind = self._factor()
            if kind != "BOOL":
                raise self._fault(f"NOT does not go with {kind}")
            return f"(not {text})", kind
        token = self._next()
        if token in ("TRUE", "FALSE"):
            return self._take().capitalize(), "BOOL"
        if token.startswith("T#"):
            return str(self._time(self._take())), "TIME"
        if token[:1].isdigit():
            return str(self._whole()), LITERAL
        if token.upper() in self._library.members:
            name, place = self._library.members[self._take().upper()]
            return str(place), name
        return self._call() if self._next(1) == "(" else self._place(writing=False)

    def _place(self, *, writing: bool) -> tuple[str, str]:
        """A variable, an element, a field: its Python and its type."""
        name = self._take()
        found = self._scope.get(name.upper())
        if found is None:
            raise self._fault(f"{name} is not declared")
        if found.name != name:
            raise self._fault(f"{name} is declared as {found.name}")
        if writing and (found.constant or found.section == "VAR_INPUT"):
            raise self._fault(f"{name} is not to be written")
        text, kind = found.python, found.kind
        while self._next() in ("[", "."):
            text, kind = self._element(text, kind) if self._is("[") else self._field(text, kind)
        return text, kind

    def _element(self, text: str, kind: str) -> tuple[str, str]:
        array = self._library.types[kind]
        if not array.element:
            raise self._fault(f"{kind} has no elements")
        index = self._as("INT")
        self._take("]")
        return f"{text}[_at({index}, {array.first}, {array.last})]", array.element

    def _field(self, text: str, kind: str) -> tuple[str, str]:
        self._take(".")
        name = self._take()
        fields = {"Q": ("Q", "BOOL"), "ET": ("ET", "TIME")} if kind == "TON" else self._library.types[kind].fields
        if name.upper() not in fields or fields[name.upper()][0] != name:
            raise self._fault(f"{kind} has no {name}")
        return f"{text}.{name}", fields[name.upper()][1]

    def _call(self) -> tuple[str, str]:
        name = self._take()
        self._take("(")
        unit = self._library.units.get(name.upper())
        if unit is None or unit.name != name:
            return self._standard(name)
        if not unit.kind:
            raise self._fault(f"{name} is no function")
        wanted = {one.name: one.kind for section in ("VAR_INPUT", "VAR_IN_OUT") for one in unit.of(section)}
        return f"f_{name}({self._arguments(wanted)})", unit.kind

    def _arguments(self, wanted: Mapping[str, str]) -> str:
        """Named arguments up to the closing bracket: each once, in any order."""
        given: dict[str, str] = {}
        while not given or self._is(","):
            name = self._take(*wanted)
            self._take(":=")
            given[name] = self._as(wanted[name])
        self._take(")")
        if set(given) != set(wanted):
            raise self._fault(f"{', '.join(sorted(set(wanted) - set(given)))} is not given")
        return ", ".join(f"{name}={text}" for name, text in given.items())

    def _standard(self, name: str) -> tuple[str, str]:
        """A function of the language, its arguments by place."""
        if self._next(1) == ":=":
            raise self._fault(f"no function {name} with named arguments is known here")
        given = [self._term()]
        while self._is(","):
            given.append(self._term())
        self._take(")")
        kind = given[0][1]
        if name in ("SHL", "SHR") and kind in _BITS and len(given) == 2:
            by = self._fitted(*given[1], "INT")
            text = f"({given[0][0]} >> {by})" if name == "SHR" else f"(({given[0][0]} << {by}) & {RANGES[kind][1]})"
            return text, kind
        if name == "MIN" and kind in _NUMBERS and len(given) == 2:
            return f"min({given[0][0]}, {self._fitted(*given[1], kind)})", kind
        if name == "SEL" and kind == "BOOL" and len(given) == 3:
            one, other = given[1], given[2]
            wanted = one[1] if one[1] != LITERAL else other[1]
            both = [self._fitted(*part, wanted) for part in (one, other)]
            return f"({both[1]} if {given[0][0]} else {both[0]})", wanted
        source, to, target = name.partition("_TO_")
        if to and source in RANGES and target in RANGES and kind == source and len(given) == 1:
            inside = RANGES[target][0] <= RANGES[source][0] and RANGES[source][1] <= RANGES[target][1]
            return (given[0][0] if inside else f"_bits({given[0][0]}, '{target}')"), target
        raise self._fault(f"no function {name} is known here for {', '.join(kind for _, kind in given)}")
