"""Expressions by the printed priority of operators, with their types, functions and variables.

Reading is by precedence climbing: `_read_operation` takes an operand, then every operator at least as strong as its
floor, and reads the right side with the floor raised by one, so that equal operators bind to the left. Strongest to
weakest::

    * / DIV MOD  >  + -  >  B_AND  >  B_XOR  >  B_OR  >  AND  >  XOR  >  OR  >  <<  >  == <> < > <= >=

A comparison binds weakest of all, so ``A == 1 AND B == 2`` reads ``A == (1 AND B) == 2``. It is refused although it is
legal, because nobody means it. Each reader returns the type of what it read; "?" is a type that only the running
program knows, and it goes with everything.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.lexer import Cursor, IllegalBlock, check_file_name

# The types of the language and what converts into what, as the manuals' table prints it.

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


def check_assignment(target: str, name: str, given: str) -> None:
    """Raise IllegalBlock if a value of type ``given`` does not become ``target`` by itself."""
    if UNKNOWN not in (target, given) and given not in _INTO[target]:
        raise IllegalBlock("E-LEGAL-TYPE", name=name, target=target, given=given)


def check_operand(operator: str, given: str, *, text: bool = False) -> None:
    """Raise IllegalBlock if ``operator`` takes no such operand; ``text`` admits STRING."""
    if given != UNKNOWN and given not in NUMERIC and not (text and given == "STRING"):
        raise IllegalBlock("E-LEGAL-OPERAND", operator=operator, given=given)


def check_comparison(operator: str, left: str, right: str) -> None:
    """STRING, AXIS and FRAME know == and <> only, and only among themselves."""
    if UNKNOWN in (left, right) or (left in NUMERIC and right in NUMERIC):
        return
    alike = left == right or {left, right} == {"STRING", "CHAR"}
    if operator in _ORDERED or not alike:
        raise IllegalBlock("E-LEGAL-COMPARISON", operator=operator, left=left, right=right)


def arithmetic_type(operator: str, left: str, right: str) -> str:
    """The type of left operator right for + - * / DIV MOD and the bit operators."""
    check_operand(operator, left)
    check_operand(operator, right)
    if UNKNOWN in (left, right):
        return UNKNOWN
    return "REAL" if operator == "/" or "REAL" in (left, right) else "INT"


# The language's functions: how many values they take, of which kind, and what they return.


class Signature(NamedTuple):
    """Fewest and most values, the type of each ("?" is not judged), the type returned."""

    least: int
    most: int
    takes: tuple[str, ...]
    gives: str


def _unary(kind: str, gives: str) -> Signature:
    return Signature(1, 1, (kind,), gives)


_REAL = _unary("REAL", "REAL")
_POSITION = _unary("REAL", "REAL")

SIGNATURES: dict[str, Signature] = {
    **dict.fromkeys(("SIN", "COS", "TAN", "ASIN", "ACOS", "SQRT", "ABS", "POT", "LN", "EXP", "TRUNC"), _REAL),
    **dict.fromkeys(("ROUND", "ROUNDUP"), _REAL),
    **dict.fromkeys(("AC", "IC", "DC", "ACP", "ACN", "CAC", "CIC", "CDC", "CACP", "CACN"), _POSITION),
    "ATAN2": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "MINVAL": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "MAXVAL": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "BOUND": Signature(3, 3, ("REAL", "REAL", "REAL"), "REAL"),
    "RTOI": _unary("REAL", "INT"),
    "ITOR": _unary("INT", "REAL"),
    "NUMBER": _unary("STRING", "REAL"),
    "ISNUMBER": _unary("STRING", "BOOL"),
    "ISFILE": _unary("STRING", "BOOL"),
    "ISVAR": _unary("STRING", "BOOL"),
    "GETVARTYP": _unary("STRING", "INT"),
    "STRLEN": _unary("STRING", "INT"),
    "TOUPPER": _unary("STRING", "STRING"),
    "TOLOWER": _unary("STRING", "STRING"),
    "INDEX": Signature(2, 2, ("STRING", "CHAR"), "INT"),
    "RINDEX": Signature(2, 2, ("STRING", "CHAR"), "INT"),
    "SUBSTR": Signature(2, 3, ("STRING", "INT", "INT"), "STRING"),
    "AXNAME": _unary("STRING", "AXIS"),
    "AXSTRING": _unary("AXIS", "STRING"),
    "ISAXIS": _unary("INT", "BOOL"),
    "SPI": _unary("INT", "AXIS"),
}

PROCEDURES: dict[str, Signature] = {
    "MSG": Signature(0, 2, ("STRING", "INT"), ""),
    "WRITE": Signature(3, 3, (UNKNOWN, "STRING", "STRING"), ""),
    "DELETE": Signature(2, 2, (UNKNOWN, "STRING"), ""),
    "READ": Signature(5, 5, (UNKNOWN, "STRING", "INT", "INT", UNKNOWN), ""),
    "SETAL": Signature(1, 2, ("INT", "STRING"), ""),
    "STOPRE": Signature(0, 0, (), ""),
    "NEWCONF": Signature(0, 0, (), ""),
    "TRAFOOF": Signature(0, 0, (), ""),
}


def check_values(name: str, signature: Signature, given: list[str]) -> None:
    """Raise IllegalBlock for a wrong number of values, or one that does not become what is taken."""
    if not signature.least <= len(given) <= signature.most:
        least, most = signature.least, signature.most
        wanted = str(least) if least == most else f"{least} to {most}"
        raise IllegalBlock("E-LEGAL-VALUES", name=name, given=len(given), wanted=wanted)
    for taken, kind in zip(signature.takes, given, strict=False):
        check_assignment(taken, name, kind)


# Variables with their indices: of the system, of the user, and the R parameters.

ReadExpression = Callable[[Cursor], str]
_AXIAL = re.compile(r"\$MA_|\$SA_|\$AA_ENC_COMP|\$[AV]A_IM|\$VA_\w*COMP_VAL")
_COUNTED = re.compile(r"\$MN_|\$SN_|\$MC_|\$SC_|\$AN_|\$TC_")
_FRAME_PART = 2  # $P_UIFR[1,X,TR]: an axis and a part behind the frame's own indices


def read_system_variable(cursor: Cursor, reads: ReadExpression) -> str:
    """Read $NAME[...] and return its type. Raises IllegalBlock for an unknown name or wrong indices."""
    name = cursor.take().text
    datum = dictionary().data.get(name)
    if datum is None:
        raise IllegalBlock("E-LEGAL-VARIABLE", name=name)
    given = read_indices(cursor, name, reads) if cursor.sees("[") else []
    if datum.type == "FRAME" and len(given) == datum.indices + _FRAME_PART:
        return "REAL"
    if len(given) != datum.indices:
        raise IllegalBlock("E-LEGAL-INDICES", name=name, given=len(given), wanted=datum.indices)
    _check_index_types(name, given)
    return datum.type


def read_user_variable(cursor: Cursor, reads: ReadExpression) -> str:
    """Read a declared variable with its indices and return the element's type."""
    name = cursor.take().text
    declared = cursor.scope.variables[name]
    if not cursor.sees("["):
        return declared.type if not declared.sizes else UNKNOWN
    given = read_indices(cursor, name, reads, declared.sizes)
    letter = declared.type == "STRING" and len(given) == len(declared.sizes) + 1
    if len(given) != len(declared.sizes) and not letter:
        raise IllegalBlock("E-LEGAL-INDICES", name=name, given=len(given), wanted=len(declared.sizes))
    _check_numeric(name, given)
    return "CHAR" if letter else declared.type


def read_r_parameter(cursor: Cursor, reads: ReadExpression) -> str:
    """Read R10 or R[...]; the number is whole and not negative."""
    text = cursor.take().text
    if len(text) > 1:
        if "." in text:
            raise IllegalBlock("E-LEGAL-R", text=text)
    elif cursor.sees("["):
        given = read_indices(cursor, "R", reads)
        if len(given) != 1:
            raise IllegalBlock("E-LEGAL-INDICES", name="R", given=len(given), wanted=1)
        _check_numeric("R", given)
    else:
        raise IllegalBlock("E-LEGAL-R", text=f"R{cursor.token.text}")
    return "REAL"


def read_indices(cursor: Cursor, name: str, reads: ReadExpression, sizes: tuple[int, ...] = ()) -> list[str]:
    """Read [a,b,...] and return the types; a constant must be whole, not negative and inside its size."""
    cursor.expect("[")
    given: list[str] = []
    while True:
        size = sizes[len(given)] if len(given) < len(sizes) else None
        _check_constant_index(cursor, name, size)
        given.append(reads(cursor))
        if not cursor.accept(","):
            break
    cursor.expect("]")
    return given


def _check_constant_index(cursor: Cursor, name: str, size: int | None) -> None:
    token, behind = cursor.token, cursor.after
    if token.text == "-" and behind.kind == "number":
        raise IllegalBlock("E-LEGAL-INDEX-VALUE", name=name, value=f"-{behind.text}")
    if token.kind != "number" or behind.text not in (",", "]"):
        return
    whole = re.fullmatch(r"[0-9]{1,9}", token.text)
    if not whole or (size is not None and int(token.text) >= size):
        raise IllegalBlock("E-LEGAL-INDEX-VALUE", name=name, value=token.text)


def _check_index_types(name: str, given: list[str]) -> None:
    """The axis of an axial datum stands last; everything else is counted."""
    if _AXIAL.match(name) and given:
        if given[-1] not in ("AXIS", UNKNOWN):
            raise IllegalBlock("E-LEGAL-INDEX-AXIS", name=name, place=len(given))
        _check_numeric(name, given[:-1])
    elif _COUNTED.match(name):
        _check_numeric(name, given)


def _check_numeric(name: str, given: list[str]) -> None:
    for place, kind in enumerate(given, 1):
        if kind not in NUMERIC and kind != UNKNOWN:
            raise IllegalBlock("E-LEGAL-INDEX-NUMBER", name=name, place=place, given=kind)


# Expressions.

COMPARISONS = frozenset({"==", "<>", "<", ">", "<=", ">="})
_LOGIC = frozenset({"AND", "OR", "XOR"})
_COMPARING, _CHAINING, _PRODUCT = 0, 1, 9
_PRIORITY = {  # printed, strongest first; a comparison binds weakest of all
    **dict.fromkeys(("*", "/", "DIV", "MOD"), _PRODUCT),
    **dict.fromkeys(("+", "-"), 8),
    "B_AND": 7,
    "B_XOR": 6,
    "B_OR": 5,
    "AND": 4,
    "XOR": 3,
    "OR": 2,
    "<<": _CHAINING,
    **dict.fromkeys(COMPARISONS, _COMPARING),
}
_CONSTANTS = {"TRUE": "BOOL", "FALSE": "BOOL", "NO_AXIS": "AXIS"}
_AXIS_PARTS = frozenset({"TR", "FI", "RT", "SC", "MI"})


def read_expression(cursor: Cursor) -> str:
    """Read one expression and return its type ("?" where it cannot be known). Raises IllegalBlock."""
    kind, _ = _read_operation(cursor, _COMPARING)
    while kind in ("FRAME", UNKNOWN) and cursor.accept(":"):  # frames are chained
        _read_operation(cursor, _COMPARING)
    if cursor.sees("="):
        raise IllegalBlock("E-LEGAL-OPERATOR", operator="=", wanted="==")
    return kind


def read_condition(cursor: Cursor) -> None:
    """An expression that is true or false. Raises IllegalBlock for one that is neither."""
    check_operand("a condition", read_expression(cursor), text=True)


def read_values(cursor: Cursor) -> list[str]:
    """The values of a call in round brackets; places may be left empty. Returns their types."""
    cursor.expect("(")
    given: list[str] = []
    if cursor.accept(")"):
        return given
    while True:
        given.append(UNKNOWN if cursor.sees(",", ")") else read_expression(cursor))
        if not cursor.accept(","):
            break
    cursor.expect(")")
    return given


def _read_operation(cursor: Cursor, floor: int) -> tuple[str, str]:
    """Read operators at least as strong as ``floor``; returns the type and the weakest operator used."""
    kind, used = _read_operand(cursor)
    while (operator := cursor.token.text) in _PRIORITY and cursor.token.kind in ("op", "name"):
        priority = _PRIORITY[operator]
        if priority < floor:
            break
        cursor.take()
        right, used_right = _read_operation(cursor, priority + 1)
        if priority == _COMPARING:
            _check_bracketed(operator, used, used_right)
        kind, used = _result_type(operator, kind, right), operator
    _refuse_foreign_operator(cursor)
    return kind, used


def _check_bracketed(operator: str, left: str, right: str) -> None:
    """A == 1 AND B == 2 reads A == (1 AND B) == 2: nobody means that."""
    for other in (left, right):
        if other in _LOGIC or other in COMPARISONS or other == "NOT":
            raise IllegalBlock("E-LEGAL-PRIORITY", operator=operator, other=other)


def _refuse_foreign_operator(cursor: Cursor) -> None:
    """Signs that other languages use where this one has its own."""
    pair = cursor.token.text + cursor.after.text
    if pair in ("=>", "=<", "=="):
        raise IllegalBlock("E-LEGAL-OPERATOR", operator=pair, wanted=">= <= ==")


def _result_type(operator: str, left: str, right: str) -> str:
    if operator in COMPARISONS:
        check_comparison(operator, left, right)
        return "BOOL"
    if operator == "<<":
        check_operand(operator, left, text=True)
        check_operand(operator, right, text=True)
        return "STRING"
    if operator in _LOGIC:
        check_operand(operator, left)
        check_operand(operator, right)
        return "BOOL"
    return arithmetic_type(operator, left, right)


def _read_operand(cursor: Cursor) -> tuple[str, str]:
    """One operand with its signs; the second item is "NOT" where that stood before it."""
    if cursor.sees("NOT", "B_NOT"):
        operator = cursor.take().text
        kind, _ = _read_operand(cursor)
        check_operand(operator, kind)
        doubtful = operator == "NOT" and kind != "BOOL"  # NOT R1 == 2 reads (NOT R1) == 2
        return ("BOOL" if operator == "NOT" else "INT"), "NOT" if doubtful else ""
    if cursor.sees("-", "+"):
        return _read_signed(cursor), ""
    if cursor.accept("<<"):
        if cursor.sees("<<"):
            raise cursor.wrong("a value")
        kind, _ = _read_operation(cursor, _CHAINING + 1)
        check_operand("<<", kind, text=True)
        return "STRING", "<<"
    return _read_value(cursor), ""


def _read_signed(cursor: Cursor) -> str:
    sign = ""
    while cursor.sees("-", "+"):
        sign = cursor.take().text
    kind, _ = _read_operand(cursor)
    check_operand(sign, kind)
    return kind


def _read_value(cursor: Cursor) -> str:
    token = cursor.token
    if token.kind == "number":
        cursor.take()
        return "REAL" if "." in token.text or "EX" in token.text else "INT"
    if token.kind in ("string", "constant"):
        cursor.take()
        return "STRING" if token.kind == "string" else "INT"
    if token.kind == "variable":
        return read_system_variable(cursor, read_expression)
    if token.kind == "din":
        return _read_numbered(cursor)
    if token.kind == "name":
        return _read_name(cursor)
    return _read_bracketed(cursor)


def _read_bracketed(cursor: Cursor) -> str:
    if not cursor.sees("("):
        raise cursor.wrong("a value")
    cursor.take()
    kind = read_expression(cursor)
    cursor.expect(")")
    return kind


def _read_numbered(cursor: Cursor) -> str:
    """R10 is a parameter, X1 an axis; any other letter with a number is no value."""
    text = cursor.token.text
    if text[0] == "R":
        return read_r_parameter(cursor, read_expression)
    if not cursor.scope.is_axis(text):
        raise cursor.wrong("a value")
    cursor.take()
    return "AXIS"


def _read_name(cursor: Cursor) -> str:
    text = cursor.token.text
    if text in cursor.scope.variables:
        return read_user_variable(cursor, read_expression)
    if text == "R":
        return read_r_parameter(cursor, read_expression)
    if cursor.after.text == "(" and cursor.after.kind == "op":
        return _read_function(cursor)
    if text in _CONSTANTS or text in _AXIS_PARTS:
        cursor.take()
        return _CONSTANTS.get(text, UNKNOWN)
    if cursor.scope.is_axis(text):
        cursor.take()
        return "AXIS"
    return _read_other_name(cursor)


def _read_other_name(cursor: Cursor) -> str:
    text = cursor.token.text
    if text in cursor.scope.macros or text in dictionary().data:
        cursor.take()
        return UNKNOWN
    if text in dictionary().reserved:
        raise cursor.wrong("a value")
    raise IllegalBlock("E-LEGAL-UNDEFINED", name=text)


def _read_function(cursor: Cursor) -> str:
    name = cursor.token.text
    if name not in dictionary().functions:
        known = name in dictionary().reserved
        raise cursor.wrong("a function") if known else IllegalBlock("E-LEGAL-WORD", word=name)
    cursor.take()
    parts = cursor.arguments()
    given = read_values(cursor)
    signature = SIGNATURES.get(name)
    if signature is None:
        return UNKNOWN
    check_values(name, signature, given)
    if name == "ISFILE" and parts[0][0].kind == "string" and len(parts[0]) == 1:
        check_file_name(parts[0][0].text[1:-1])
    return signature.gives
