"""The words of an ordinary block: commands, addresses with values, assignments, calls."""

from __future__ import annotations

from math import prod

from drivers.sinumerik.legality.calls import call
from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.expressions import expression, values
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.groups import GROUP_OF
from drivers.sinumerik.legality.lexer import Token
from drivers.sinumerik.legality.types import judge_assignment
from drivers.sinumerik.legality.variables import indices, parameter, system_variable, user_variable

_WHOLE = frozenset("MLDNG")  # printed: these addresses take whole numbers
_EXTENDED = frozenset("ABCEIJKQUVWXYZSMHTFRG")  # printed: addresses that take a number as extension
_AXES_BY_TEXT = ("$AN_CEC_INPUT_AXIS", "$AN_CEC_OUTPUT_AXIS")  # printed: (AX2), or a text "AX2"
_WITHOUT_VALUE = ("DIA",)  # DIAMOFA[X]: the axis says it all
_UNJUDGED = frozenset({"ID", "IDS", "WHEN", "WHENEVER", "EVERY", "FROM", "DO", "REDEF", "MCALL", "CALL", "PCALL"}) | {
    "ISOCALL",
    "EXTCALL",
    "CTABEND",
    "BLSYNC",
}


class Commands:
    """Remembers the groups of one block: no two commands of one group."""

    def __init__(self) -> None:
        self._seen: dict[int, str] = {}

    def note(self, word: str) -> None:
        """Raise Illegal if another command of this word's group stands in the block already."""
        group = GROUP_OF.get(word)
        if group is None:
            return
        if group in self._seen:
            raise Illegal("E-LEGAL-G-GROUP", word=word, other=self._seen[group], group=group)
        self._seen[group] = word


def word(cursor: Cursor, commands: Commands) -> None:
    """Read one word of a block. Raises Illegal."""
    token = cursor.token
    if token.kind == "variable":
        _assign(cursor, token.text, system_variable(cursor, expression))
    elif token.kind == "din":
        _numbered(cursor, commands)
    elif token.kind == "name":
        _named(cursor, commands)
    else:
        raise cursor.wrong("a word of the language")


def _assign(cursor: Cursor, name: str, target: str, before: int = 0) -> None:
    """Read = value behind what is set; ``before``: how many elements of its array come before it, for certain."""
    if cursor.sees("=="):
        raise Illegal("E-LEGAL-OPERATOR", operator="==", wanted="=")
    if not cursor.accept("="):
        raise Illegal("E-LEGAL-ASSIGN", name=name, found=cursor.token.text or "the end of the block")
    if cursor.sees("SET", "REP"):
        repeated = cursor.take().text == "REP"
        given = values(cursor)
        judge_list(cursor, name, given[:1] if repeated else given, before)
        return
    if name.startswith(_AXES_BY_TEXT) and cursor.token.kind == "string":
        cursor.take()
        return
    declared = cursor.scope.variables.get(name)
    if declared is not None:
        judge_constant(cursor, name, declared.type, declared.length)
    judge_assignment(target, name, expression(cursor))


def judge_list(cursor: Cursor, name: str, given: list[str], before: int = 0) -> None:
    """SET and REP fill an array of the user's from an element on: each value its type, and no more than there is room.

    ``given``: the types of the values. Raises Illegal. Arrays of the system are not judged.
    """
    declared = cursor.scope.variables.get(name)
    if declared is None:
        return
    room = prod(declared.sizes) - before
    if len(given) > room:
        raise Illegal("E-LEGAL-LIST", name=name, given=len(given), room=room)
    for kind in given:
        judge_assignment(declared.type, name, kind)


def _elements_before(cursor: Cursor, sizes: tuple[int, ...]) -> int:
    """How many elements come before the one that stands next, by constant indices; 0 where they are not constant."""
    look = cursor.fork()
    look.take()
    if not look.sees("["):
        return 0
    parts = [[token.text for token in part if token.text != "["] for part in look.arguments()]
    if len(parts) != len(sizes) or not all(len(part) == 1 and part[0].isdigit() for part in parts):
        return 0
    place = 0
    for part, size in zip(parts, sizes, strict=True):
        place = place * size + int(part[0][:9])
    return place


def judge_constant(cursor: Cursor, name: str, kind: str, length: int) -> None:
    """A constant must fit the variable it is given to: a text its length, a whole number its 32 bits."""
    token = cursor.token
    if length and token.kind == "string" and len(token.text) - 2 > length:
        raise Illegal("E-LEGAL-STRING-FULL", name=name, length=len(token.text) - 2, limit=length)
    digits = cursor.after if token.text == "-" else token
    if kind == "INT" and digits.kind == "number" and digits.text.isdigit() and len(digits.text) > 9:
        value = int(digits.text[:20])
        if value > 2**31 - (token.text != "-"):
            raise Illegal("E-LEGAL-INTEGER", name=name, value=digits.text)


def _numbered(cursor: Cursor, commands: Commands) -> None:
    """G1, M30, X10.5, R10=..., X1=...: a letter with digits."""
    token = cursor.token
    letter = token.text[0]
    if letter == "R":
        _assign(cursor, token.text, parameter(cursor, expression))
    elif cursor.after.text == "=" and letter in _EXTENDED:
        cursor.take()
        _extended(cursor, token)
    else:
        cursor.take()
        _plain(token, letter, commands)


def _extended(cursor: Cursor, token: Token) -> None:
    if "." in token.text:
        raise Illegal("E-LEGAL-NUMBER", text=token.text)
    cursor.expect("=")
    _address_value(cursor, token.text)


def _plain(token: Token, letter: str, commands: Commands) -> None:
    if letter == "N":
        raise Illegal("E-LEGAL-BLOCK-NUMBER", text=token.text)
    if letter == "G":
        _g_command(token, commands)
    elif letter in _WHOLE and "." in token.text:
        raise Illegal("E-LEGAL-NUMBER", text=token.text)


def _g_command(token: Token, commands: Commands) -> None:
    digits = token.text[1:]
    name = f"G{int(digits)}" if digits.isdigit() and len(digits) < 9 else token.text
    if name not in dictionary().commands:
        raise Illegal("E-LEGAL-G-UNKNOWN", word=token.text)
    commands.note(name)


def _named(cursor: Cursor, commands: Commands) -> None:
    text = cursor.token.text
    if text in cursor.scope.variables:
        before = _elements_before(cursor, cursor.scope.variables[text].sizes)
        _assign(cursor, text, user_variable(cursor, expression), before)
    elif text == "R":
        _assign(cursor, text, parameter(cursor, expression))
    elif text in cursor.scope.macros or text in _UNJUDGED:
        cursor.skip()
    elif text in cursor.scope.routines:
        call(cursor)
    else:
        _of_language(cursor, text, commands)


def _of_language(cursor: Cursor, text: str, commands: Commands) -> None:
    lists = dictionary()
    if len(text) == 1:
        cursor.take()
        _letter(cursor, text)
    elif cursor.scope.is_axis(text):
        cursor.take()
        _assign_value(cursor, text)
    elif text in lists.addresses or text == "AX":
        cursor.take()
        _address(cursor, text)
    elif text in lists.commands:
        cursor.take()
        commands.note(text)
    elif text in lists.procedures:
        call(cursor)
    else:
        raise _misplaced(cursor, text)


def _misplaced(cursor: Cursor, text: str) -> Illegal:
    lists = dictionary()
    if text in lists.keywords:
        return Illegal("E-LEGAL-PLACE", word=text)
    if text in lists.reserved:
        return cursor.wrong("a word that may stand in a block")
    if cursor.after.text in ("=", "==", "["):
        return Illegal("E-LEGAL-UNDEFINED", name=text)
    return Illegal("E-LEGAL-WORD", word=text)


def _letter(cursor: Cursor, letter: str) -> None:
    """X=..., X -10, S[1]=..., F R1 (refused): a single address letter."""
    if letter in ("N", "L"):
        raise Illegal("E-LEGAL-ASSIGN", name=letter, found=cursor.token.text or "the end of the block")
    if cursor.sees("="):
        _assign_value(cursor, letter)
        return
    if cursor.sees("["):
        indices(cursor, letter, expression)
        _assign_value(cursor, letter)
        return
    signed = cursor.sees("-", "+")
    number = cursor.after if signed else cursor.token
    if number.kind != "number":
        raise Illegal("E-LEGAL-ASSIGN", name=letter, found=cursor.token.text or "the end of the block")
    for _ in range(1 + signed):
        cursor.take()


def _address(cursor: Cursor, name: str) -> None:
    """FA[X]=..., SPOS=..., DIAMOFA[X]: an address of several letters needs its equals sign."""
    if cursor.sees("["):
        indices(cursor, name, expression)
        if name.startswith(_WITHOUT_VALUE) and not cursor.sees("="):
            return
    _assign_value(cursor, name)


def _assign_value(cursor: Cursor, name: str) -> None:
    if not cursor.accept("="):
        raise Illegal("E-LEGAL-ASSIGN", name=name, found=cursor.token.text or "the end of the block")
    _address_value(cursor, name)


def _address_value(cursor: Cursor, name: str) -> None:
    """An axis takes a number; other addresses take several in brackets too, an axis, a text."""
    if cursor.scope.is_axis(name) or name == "F":
        judge_assignment("REAL", name, expression(cursor))
    elif cursor.sees("(") and len(cursor.arguments()) > 1:
        values(cursor)  # (1,2,3) is a list, (1+2)*3 one value that begins with a bracket
    else:
        expression(cursor)
