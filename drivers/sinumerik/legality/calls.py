"""Calls: procedures of the language, cycles, sub-programs; the lengths of what they write and show."""

from __future__ import annotations

from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.expressions import values
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.functions import PROCEDURES, judge_values
from drivers.sinumerik.legality.lexer import Token
from drivers.sinumerik.legality.names import judge_file_name

MESSAGE, WRITTEN = 124, 200  # characters: of a text on the screen, of a line in a file
_FILES = {"WRITE": 2, "DELETE": 2, "READ": 2}  # which value names a file
_RESULTS = frozenset({"WRITE", "DELETE", "READ"})  # their first value is a variable that takes the result
_TEXTS = {"MSG": (1, MESSAGE, "E-LEGAL-MSG"), "WRITE": (3, WRITTEN, "E-LEGAL-WRITE")}


def call(cursor: Cursor) -> None:
    """Read NAME or NAME(...). Raises Illegal for wrong values, file names and too long texts."""
    name = cursor.take().text
    given: list[str] = []
    parts: list[list[Token]] = []
    if cursor.sees("("):
        parts = cursor.arguments()
        given = values(cursor)
    signature = PROCEDURES.get(name)
    if signature is not None:
        judge_values(name, signature, given)
        _judge_texts(name, parts)


def judge_file(part: list[Token]) -> None:
    """Raise Illegal unless a lone text in quotes names a file of the control; chained texts are not judged."""
    if len(part) == 1 and part[0].kind == "string":
        judge_file_name(part[0].text[1:-1])


def _judge_texts(name: str, parts: list[list[Token]]) -> None:
    if name in _RESULTS:
        _judge_result(name, parts[0])
    if name in _FILES:
        judge_file(parts[_FILES[name] - 1])
    if name in _TEXTS:
        place, limit, code = _TEXTS[name]
        length = _shortest(parts[place - 1]) if len(parts) >= place else 0
        if length > limit:
            raise _too_long(code, length, limit)


def _too_long(code: str, length: int, limit: int) -> Illegal:
    return Illegal(code, length=length, limit=limit)


def _judge_result(name: str, part: list[Token]) -> None:
    """What takes the result must be a variable of the program."""
    first = part[0] if part else None
    if first is None or first.kind not in ("name", "din", "variable") or first.text in dictionary().functions:
        raise Illegal("E-LEGAL-RESULT", name=name, found=first.text if first else "nothing")


def _shortest(part: list[Token]) -> int:
    """The least number of characters that a chain of texts and values can have: its texts outside brackets."""
    depth = length = 0
    for token in part:
        depth += (token.text in ("(", "[")) - (token.text in (")", "]"))
        if token.kind == "string" and depth == 0:
            length += len(token.text) - 2
    return length
