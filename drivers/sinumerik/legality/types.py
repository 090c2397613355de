"""The types of the language and what converts into what, as the manuals' table prints it."""

from __future__ import annotations

from drivers.sinumerik.legality.findings import Illegal

UNKNOWN = "?"
NUMERIC = frozenset({"BOOL", "CHAR", "INT", "REAL"})
_INTO = {  # target: what is converted on assignment
    "REAL": NUMERIC,
    "INT": NUMERIC,
    "BOOL": NUMERIC | {"STRING"},
    "CHAR": NUMERIC | {"STRING"},
    "STRING": frozenset({"STRING", "CHAR", "BOOL"}),
    "AXIS": frozenset({"AXIS"}),
    "FRAME": frozenset({"FRAME"}),
}
_ORDERED = frozenset({"<", ">", "<=", ">="})


def judge_assignment(target: str, name: str, given: str) -> None:
    """Raise Illegal if a value of type ``given`` does not become ``target`` by itself."""
    if UNKNOWN not in (target, given) and given not in _INTO[target]:
        raise Illegal("E-LEGAL-TYPE", name=name, target=target, given=given)


def judge_operand(operator: str, given: str, *, text: bool = False) -> None:
    """Raise Illegal if ``operator`` takes no such operand; ``text`` admits STRING."""
    if given != UNKNOWN and given not in NUMERIC and not (text and given == "STRING"):
        raise Illegal("E-LEGAL-OPERAND", operator=operator, given=given)


def judge_comparison(operator: str, left: str, right: str) -> None:
    """STRING, AXIS and FRAME know == and <> only, and only among themselves."""
    if UNKNOWN in (left, right) or (left in NUMERIC and right in NUMERIC):
        return
    alike = left == right or {left, right} == {"STRING", "CHAR"}
    if operator in _ORDERED or not alike:
        raise Illegal("E-LEGAL-COMPARISON", operator=operator, left=left, right=right)


def arithmetic(operator: str, left: str, right: str) -> str:
    """The type of left operator right for + - * / DIV MOD and the bit operators."""
    judge_operand(operator, left)
    judge_operand(operator, right)
    if UNKNOWN in (left, right):
        return UNKNOWN
    return "REAL" if operator == "/" or "REAL" in (left, right) else "INT"
