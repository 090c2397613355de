"""Expressions as closures: compiled once for each block, evaluated against a scope."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

from simulators.nck.language.syntax import Binary, Call, Expression, Indexed, Name, Number, Text, Unary, ValueList
from simulators.nck.program.functions import FUNCTIONS, calculated, called
from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, compared, joined, number, readable, truth, whole

COMPARISONS = frozenset({"==", "<>", "<", ">", "<=", ">="})
R_NAME = re.compile(r"R(\d{1,5})")


class Scope(Protocol):
    """What an expression may ask of its surroundings."""

    def variable(self, name: str, indices: tuple[Value, ...]) -> Value:
        """A local variable, R parameter, ``$`` variable or axis by name. Raises NckRefusal 12550."""
        ...

    def function(self, name: str, given: tuple[Value, ...]) -> Value:
        """A function that needs the machine (ISFILE, AXNAME ...). Raises NckRefusal 12550."""
        ...


Evaluate = Callable[[Scope], Value]


def compiled(node: Expression) -> Evaluate:
    """The closure that evaluates an expression."""
    if isinstance(node, Number | Text):
        constant: Value = node.value
        return lambda _scope: constant
    if isinstance(node, Name):
        return _name(node.name)
    if isinstance(node, Indexed):
        return _indexed(node)
    if isinstance(node, Call):
        return _call(node)
    if isinstance(node, Unary):
        return _unary(node)
    if isinstance(node, ValueList):
        raise NckRefusal(12150, "a list of values stands in assignments to arrays only")
    return _binary(node)


def _name(name: str) -> Evaluate:
    if name in ("TRUE", "FALSE"):
        flag = name == "TRUE"
        return lambda _scope: flag
    if name in ("PI", "$PI"):
        return lambda _scope: 3.141592653589793
    r_name = R_NAME.fullmatch(name)
    if r_name is not None:
        index = (int(r_name[1]),)
        return lambda scope: scope.variable("R", index)
    return lambda scope: scope.variable(name, ())


def _indexed(node: Indexed) -> Evaluate:
    name = node.name
    indices = [compiled(index) for index in node.indices]
    if len(indices) == 1:
        only = indices[0]
        return lambda scope: scope.variable(name, (only(scope),))
    return lambda scope: scope.variable(name, tuple([index(scope) for index in indices]))


def _call(node: Call) -> Evaluate:
    name = node.name
    if name in ("ISVAR", "GETVARTYP") and len(node.arguments) == 1 and isinstance(node.arguments[0], Text):
        text = node.arguments[0].value
        return lambda scope: scope.function(name, (text,))
    given = [compiled(argument) for argument in node.arguments]
    if name in FUNCTIONS:
        return lambda scope: called(name, [argument(scope) for argument in given])
    return lambda scope: scope.function(name, tuple([argument(scope) for argument in given]))


def _unary(node: Unary) -> Evaluate:
    operand = compiled(node.operand)
    if node.operator == "-":
        return lambda scope: -number(operand(scope))
    if node.operator == "+":
        return lambda scope: number(operand(scope))
    if node.operator == "NOT":
        return lambda scope: not truth(operand(scope))
    if node.operator == "B_NOT":
        return lambda scope: ~whole(operand(scope))
    return lambda scope: readable(operand(scope))


def _binary(node: Binary) -> Evaluate:
    operator = node.operator
    left, right = compiled(node.left), compiled(node.right)
    if operator in COMPARISONS:
        return lambda scope: compared(operator, left(scope), right(scope))
    if operator == "<<":
        return lambda scope: joined(left(scope), right(scope))
    return lambda scope: calculated(operator, left(scope), right(scope))
