"""Runs the subset of IEC 61131-3 structured text that docs/plc is written in, apart from any PLC and from the double.

Only functions. Numbers are Python's; only conversions and shifts bound them, as their names say. Arrays are handed over
by reference, which is the same for code that does not write to what it was only given.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Scope = dict[str, Any]
Term = Callable[[Scope], Any]
Step = Callable[[Scope], None]

_TOKEN = re.compile(r"\s*(16#[0-9A-F]+|T#\d+m?s|\d+|[A-Za-z_]\w*|:=|<>|<=|>=|\.\.|[-+*/()\[\],;:=<>.])")
_BLOCK = re.compile(r"^(FUNCTION_BLOCK|FUNCTION)\s+(TF_\w+)(?:\s*:\s*(\w+))?(.*?)^END_\1", re.MULTILINE | re.DOTALL)
_VARIABLES = re.compile(r"^VAR(\w*)(?:\s+(?:CONSTANT|RETAIN))?\n(.*?)^END_VAR\n", re.MULTILINE | re.DOTALL)
_ONE = re.compile(r"^\s+(\w+)\s*:\s*([^;:=]+?)(?:\s*:=\s*([^;]+))?;", re.MULTILINE)
_LEVELS = (("OR",), ("XOR",), ("AND",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
_ACTS: dict[str, Callable[[Any, Any], Any]] = {
    "OR": lambda a, b: a | b,
    "XOR": lambda a, b: a ^ b,
    "AND": lambda a, b: a & b,
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b,
    ">=": lambda a, b: a >= b,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a // b,
}
_BITS = {"INT": 16, "UINT": 16, "WORD": 16, "DINT": 32, "DWORD": 32, "LINT": 64}
_SIGNED = ("INT", "DINT", "LINT")


def bounded(value: int, kind: str) -> int:
    """A number as a type holds it."""
    value &= (1 << _BITS[kind]) - 1
    return value - (1 << _BITS[kind]) if kind in _SIGNED and value >> (_BITS[kind] - 1) else value


class Library:
    """The functions of some files, ready to be called by name with named arguments."""

    def __init__(self, *files: Path) -> None:
        whole = "\n".join(file.read_text(encoding="utf-8") for file in files)
        text = re.sub(r"\(\*.*?\*\)", "", whole, flags=re.DOTALL)
        self._functions = {name: body for block, name, _kind, body in _BLOCK.findall(text) if block == "FUNCTION"}
        self._ready: dict[str, tuple[Mapping[str, Any], Step]] = {}

    def call(self, name: str, given: Mapping[str, Any]) -> Any:
        """What a function of the files, or one of the language, gives."""
        if name not in self._functions:
            return _standard(name, list(given.values()))
        if name not in self._ready:
            self._ready[name] = self._prepared(name)
        usual, run = self._ready[name]
        scope = {**usual, **given, name: 0}
        run(scope)
        return scope[name]

    def _prepared(self, name: str) -> tuple[Mapping[str, Any], Step]:
        body = self._functions[name]
        usual: Scope = {}
        for _, inside in _VARIABLES.findall(body):
            for variable, _kind, value in _ONE.findall(inside):
                usual[variable] = _literal(value) if value else 0
        return usual, _Parser(_VARIABLES.sub("", body), self).steps(())


def _standard(name: str, values: list[Any]) -> Any:
    if name == "SHL":
        return values[0] << values[1] & 0xFFFFFFFF
    if name == "SHR":
        return values[0] >> values[1]
    if name == "MIN":
        return min(values)
    if name == "SEL":
        return values[2] if values[0] else values[1]
    _source, _to, target = name.partition("_TO_")
    return bounded(values[0], target)


def _literal(text: str) -> int:
    return int(text.removeprefix("16#"), 16) if text.startswith("16#") else int(re.sub(r"\D", "", text))


class _Parser:
    """Recursive descent over the tokens of one body; makes closures."""

    def __init__(self, text: str, library: Library) -> None:
        self._tokens = _TOKEN.findall(text)
        assert re.sub(r"\s+", "", text) == "".join(self._tokens), "something in it is no token"
        self._at = 0
        self._library = library

    def _next(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _take(self, wanted: str = "") -> str:
        token = self._next()
        assert token, f"{wanted or 'more'} expected at the end"
        assert wanted in ("", token), f"{wanted} expected, {token} found at {self._at}"
        self._at += 1
        return token

    def steps(self, ends: tuple[str, ...]) -> Step:
        """Statements up to one of the words, which is not taken."""
        found: list[Step] = []
        while self._next() and self._next() not in ends:
            found.append(self._statement())

        def run(scope: Scope) -> None:
            for step in found:
                step(scope)

        return run

    def _statement(self) -> Step:
        word = self._next()
        made = {"IF": self._if, "FOR": self._for, "WHILE": self._while}.get(word, self._assignment)()
        self._take(";")
        return made

    def _if(self) -> Step:
        branches: list[tuple[Term, Step]] = []
        while self._next() in ("IF", "ELSIF"):
            self._take()
            condition = self.term()
            self._take("THEN")
            branches.append((condition, self.steps(("ELSIF", "ELSE", "END_IF"))))
        if self._next() == "ELSE":
            self._take()
            branches.append((lambda _scope: True, self.steps(("END_IF",))))
        self._take("END_IF")

        def run(scope: Scope) -> None:
            chosen = next((step for condition, step in branches if condition(scope)), None)
            if chosen is not None:
                chosen(scope)

        return run

    def _for(self) -> Step:
        self._take("FOR")
        name = self._take()
        self._take(":=")
        first = self.term()
        self._take("TO")
        last = self.term()
        self._take("DO")
        body = self.steps(("END_FOR",))
        self._take("END_FOR")

        def run(scope: Scope) -> None:
            for number in range(first(scope), last(scope) + 1):
                scope[name] = number
                body(scope)

        return run

    def _while(self) -> Step:
        self._take("WHILE")
        condition = self.term()
        self._take("DO")
        body = self.steps(("END_WHILE",))
        self._take("END_WHILE")

        def run(scope: Scope) -> None:
            while condition(scope):
                body(scope)

        return run

    def _assignment(self) -> Step:
        name = self._take()
        index = None
        if self._next() == "[":
            self._take()
            index = self.term()
            self._take("]")
        self._take(":=")
        value = self.term()
        if index is None:
            return lambda scope: scope.__setitem__(name, value(scope))
        return lambda scope: scope[name].__setitem__(index(scope), value(scope))

    def term(self, level: int = 0) -> Term:
        """An expression; the weakest operators first."""
        if level == len(_LEVELS):
            return self._factor()
        left = self.term(level + 1)
        while self._next() in _LEVELS[level]:
            left = self._both(_ACTS[self._take()], left, self.term(level + 1))
        return left

    @staticmethod
    def _both(act: Callable[[Any, Any], Any], left: Term, right: Term) -> Term:
        return lambda scope: act(left(scope), right(scope))

    def _factor(self) -> Term:
        token = self._take()
        if token == "(":
            inside = self.term()
            self._take(")")
            return inside
        if token in ("-", "NOT"):
            other = self._factor()
            return (lambda scope: -other(scope)) if token == "-" else (lambda scope: not other(scope))
        if token[0].isdigit():
            number = _literal(token)
            return lambda _scope: number
        if token in ("TRUE", "FALSE"):
            return lambda _scope: token == "TRUE"
        return self._named(token)

    def _named(self, name: str) -> Term:
        if self._next() == "(":
            return self._call(name)
        if self._next() != "[":
            return lambda scope: scope[name]
        self._take()
        index = self.term()
        self._take("]")
        return lambda scope: scope[name][index(scope)]

    def _call(self, name: str) -> Term:
        self._take("(")
        given: dict[str, Term] = {}
        while self._next() != ")":
            named = self._tokens[self._at + 1] == ":="
            key = self._take() if named else str(len(given))
            if named:
                self._take(":=")
            given[key] = self.term()
            if self._next() == ",":
                self._take()
        self._take(")")
        library = self._library
        return lambda scope: library.call(name, {key: value(scope) for key, value in given.items()})
