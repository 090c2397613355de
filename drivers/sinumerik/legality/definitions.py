"""What a program declares at its head: DEF, PROC, EXTERN, DEFINE."""

from __future__ import annotations

from drivers.sinumerik.legality.blocks import judge_constant, judge_list
from drivers.sinumerik.legality.cursor import Cursor, Declared
from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.expressions import expression, values
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.lexer import MAX_STRING
from drivers.sinumerik.legality.names import judge_name
from drivers.sinumerik.legality.types import judge_assignment

TYPES = frozenset({"INT", "REAL", "BOOL", "CHAR", "STRING", "AXIS", "FRAME"})
_MODIFIERS = frozenset({"NCK", "CHAN", "SYNR", "SYNW", "SYNRW", "INIPO", "INIRE", "INICF", "PRLOC"})
_NUMBERED = frozenset({"PHU", "APR", "APW", "APRP", "APWP", "APRB", "APWB"})
_MOST_SIZES = 3


def definition(cursor: Cursor) -> None:
    """DEF [range] type name[sizes][=value], ... Raises Illegal; wrong names are noted and declared all the same."""
    _modifiers(cursor)
    kind, length = _type(cursor)
    while True:
        _variable(cursor, kind, length)
        if not cursor.accept(","):
            break
    while cursor.sees("LLI", "ULI"):
        cursor.take()
        expression(cursor)
    cursor.ended()


def procedure(cursor: Cursor) -> str:
    """PROC name(parameters) attributes. Returns the name."""
    if cursor.token.kind != "name":
        raise cursor.wrong("a name")
    name = cursor.take().text
    if cursor.accept("(") and not cursor.accept(")"):
        while True:
            cursor.accept("VAR")
            _variable(cursor, *_type(cursor))
            if not cursor.accept(","):
                break
        cursor.expect(")")
    cursor.skip()
    return name


def external(cursor: Cursor) -> None:
    """EXTERN name(types): a sub-program that is called by its name."""
    name = _name(cursor)
    cursor.scope.routines.add(name)
    cursor.skip()


def macro(cursor: Cursor) -> None:
    """DEFINE name AS ...: what follows is not judged."""
    name = _name(cursor)
    cursor.scope.macros.add(name)
    cursor.expect("AS")
    cursor.skip()


def _modifiers(cursor: Cursor) -> None:
    while cursor.token.text in _MODIFIERS | _NUMBERED:
        if cursor.take().text in _NUMBERED:
            cursor.take()


def _type(cursor: Cursor) -> tuple[str, int]:
    token = cursor.token
    if token.text not in TYPES:
        raise Illegal("E-LEGAL-DEF-TYPE", found=token.text or "the end of the block")
    cursor.take()
    return token.text, _text_length(cursor) if token.text == "STRING" else 0


def _text_length(cursor: Cursor) -> int:
    cursor.expect("[")
    digits = cursor.take().text
    if not digits.isdigit() or not 0 < int(digits[:9]) <= MAX_STRING:
        raise Illegal("E-LEGAL-STRING-LENGTH", length=digits, limit=MAX_STRING)
    cursor.expect("]")
    return int(digits)


def _variable(cursor: Cursor, kind: str, length: int) -> None:
    name = _name(cursor)
    if name in cursor.scope.variables:
        cursor.noted.append(Illegal("E-LEGAL-TWICE", name=name))
    sizes = _sizes(cursor, name)
    kept = name in dictionary().reserved or cursor.scope.is_axis(name)
    if len(name) == 1 or not kept:  # a word of the language stays what it is
        cursor.scope.variables[name] = Declared(kind, sizes, length)
    if cursor.accept("="):
        _value(cursor, name, kind, length)


def _value(cursor: Cursor, name: str, kind: str, length: int) -> None:
    if cursor.sees("SET", "REP"):
        repeated = cursor.take().text == "REP"
        given = values(cursor)
        judge_list(cursor, name, given[:1] if repeated else given)
    elif cursor.sees("(") and len(cursor.arguments()) > 1:
        judge_list(cursor, name, values(cursor))
    else:
        judge_constant(cursor, name, kind, length)
        judge_assignment(kind, name, expression(cursor))


def _sizes(cursor: Cursor, name: str) -> tuple[int, ...]:
    if not cursor.accept("["):
        return ()
    found: list[int] = []
    while True:
        digits = cursor.take().text
        if not digits.isdigit() or int(digits[:9]) == 0 or len(found) == _MOST_SIZES:
            raise Illegal("E-LEGAL-INDEX-VALUE", name=name, value=digits)
        found.append(int(digits[:9]))
        if not cursor.accept(","):
            break
    cursor.expect("]")
    return tuple(found)


def _name(cursor: Cursor) -> str:
    """A name as it is written, letters and digits that the lexer parted put together again."""
    token = cursor.token
    if token.kind not in ("name", "din"):
        raise cursor.wrong("a name")
    text = cursor.take().text
    while cursor.token.kind in ("name", "din") and cursor.token.column == token.column + len(text):
        text += cursor.take().text
    try:
        judge_name(text, "variable")
    except Illegal as wrong:
        cursor.noted.append(wrong)
    return text
