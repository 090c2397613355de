"""The words of an ordinary block (commands, addresses, assignments, calls) and the declarations at a program's head.

`read_word` is called until the block ends. What a word is decides its first token: a system variable or R parameter is
assigned to, a letter with digits is a G or M command or an address, a name is looked up in this order: variables of the
program, macros, sub-programs, letters, axes, addresses, commands, procedures.
"""

from __future__ import annotations

from math import prod

from drivers.message import Message
from drivers.sinumerik.legality.dictionary import GROUP_OF, dictionary
from drivers.sinumerik.legality.expressions import (
    PROCEDURES,
    check_assignment,
    check_values,
    read_expression,
    read_indices,
    read_r_parameter,
    read_system_variable,
    read_user_variable,
    read_values,
)
from drivers.sinumerik.legality.lexer import (
    MAX_STRING,
    Cursor,
    Declared,
    IllegalBlock,
    Token,
    check_file_name,
    check_name,
)

# Calls: procedures of the language, cycles, sub-programs; the lengths of what they write and show.

MESSAGE, WRITTEN = 124, 200  # characters: of a text on the screen, of a line in a file
_FILES = {"WRITE": 2, "DELETE": 2, "READ": 2}  # which value names a file
_RESULTS = frozenset({"WRITE", "DELETE", "READ"})  # their first value is a variable that takes the result
_TEXTS = {"MSG": (1, MESSAGE, "E-LEGAL-MSG"), "WRITE": (3, WRITTEN, "E-LEGAL-WRITE")}


def read_call(cursor: Cursor) -> None:
    """Read NAME or NAME(...). Raises IllegalBlock for wrong values, file names and too long texts."""
    name = cursor.take().text
    given: list[str] = []
    parts: list[list[Token]] = []
    if cursor.sees("("):
        parts = cursor.arguments()
        given = read_values(cursor)
    signature = PROCEDURES.get(name)
    if signature is not None:
        check_values(name, signature, given)
        _check_texts(name, parts)


def check_file(part: list[Token]) -> None:
    """Raise IllegalBlock unless a lone text in quotes names a file of the control; chained texts are not judged."""
    if len(part) == 1 and part[0].kind == "string":
        check_file_name(part[0].text[1:-1])


def _check_texts(name: str, parts: list[list[Token]]) -> None:
    if name in _RESULTS:
        _check_result(name, parts[0])
    if name in _FILES:
        check_file(parts[_FILES[name] - 1])
    if name in _TEXTS:
        place, limit, code = _TEXTS[name]
        length = _least_length(parts[place - 1]) if len(parts) >= place else 0
        if length > limit:
            raise _too_long(code, length, limit)


def _too_long(code: str, length: int, limit: int) -> IllegalBlock:
    return IllegalBlock(code, length=length, limit=limit)


def _check_result(name: str, part: list[Token]) -> None:
    """What takes the result must be a variable of the program."""
    first = part[0] if part else None
    if first is None or first.kind not in ("name", "din", "variable") or first.text in dictionary().functions:
        raise IllegalBlock("E-LEGAL-RESULT", name=name, found=first.text if first else "nothing")


def _least_length(part: list[Token]) -> int:
    """The least number of characters that a chain of texts and values can have: its texts outside brackets."""
    depth = length = 0
    for token in part:
        depth += (token.text in ("(", "[")) - (token.text in (")", "]"))
        if token.kind == "string" and depth == 0:
            length += len(token.text) - 2
    return length


# Words of a block.

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


class CommandGroups:
    """Remembers the groups of one block: no two commands of one group."""

    def __init__(self) -> None:
        self._seen: dict[int, str] = {}

    def note(self, word: str) -> None:
        """Raise IllegalBlock if another command of this word's group stands in the block already."""
        group = GROUP_OF.get(word)
        if group is None:
            return
        if group in self._seen:
            raise IllegalBlock("E-LEGAL-G-GROUP", word=word, other=self._seen[group], group=group)
        self._seen[group] = word


def read_word(cursor: Cursor, commands: CommandGroups) -> None:
    """Read one word of a block. Raises IllegalBlock."""
    token = cursor.token
    if token.kind == "variable":
        _read_assignment(cursor, token.text, read_system_variable(cursor, read_expression))
    elif token.kind == "din":
        _read_numbered(cursor, commands)
    elif token.kind == "name":
        _read_named(cursor, commands)
    else:
        raise cursor.wrong(Message.of("W-NC-LANGUAGE-WORD"))


def _read_assignment(cursor: Cursor, name: str, target: str, before: int = 0) -> None:
    """Read = value behind what is set; ``before``: how many elements of its array come before it, for certain."""
    if cursor.sees("=="):
        raise IllegalBlock("E-LEGAL-OPERATOR", operator="==", wanted="=")
    if not cursor.accept("="):
        raise IllegalBlock("E-LEGAL-ASSIGN", name=name, found=cursor.token.text or Message.of("W-NC-BLOCK-END"))
    if cursor.sees("SET", "REP"):
        repeated = cursor.take().text == "REP"
        given = read_values(cursor)
        check_list(cursor, name, given[:1] if repeated else given, before)
        return
    if name.startswith(_AXES_BY_TEXT) and cursor.token.kind == "string":
        cursor.take()
        return
    declared = cursor.scope.variables.get(name)
    if declared is not None:
        check_constant(cursor, name, declared.type, declared.length)
    check_assignment(target, name, read_expression(cursor))


def check_list(cursor: Cursor, name: str, given: list[str], before: int = 0) -> None:
    """SET and REP fill an array of the user's from an element on: each value its type, and no more than there is room.

    ``given``: the types of the values. Raises IllegalBlock. Arrays of the system are not judged.
    """
    declared = cursor.scope.variables.get(name)
    if declared is None:
        return
    room = prod(declared.sizes) - before
    if len(given) > room:
        raise IllegalBlock("E-LEGAL-LIST", name=name, given=len(given), room=room)
    for kind in given:
        check_assignment(declared.type, name, kind)


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


def check_constant(cursor: Cursor, name: str, kind: str, length: int) -> None:
    """A constant must fit the variable it is given to: a text its length, a whole number its 32 bits."""
    token = cursor.token
    if length and token.kind == "string" and len(token.text) - 2 > length:
        raise IllegalBlock("E-LEGAL-STRING-FULL", name=name, length=len(token.text) - 2, limit=length)
    digits = cursor.after if token.text == "-" else token
    if kind == "INT" and digits.kind == "number" and digits.text.isdigit() and len(digits.text) > 9:
        value = int(digits.text[:20])
        if value > 2**31 - (token.text != "-"):
            raise IllegalBlock("E-LEGAL-INTEGER", name=name, value=digits.text)


def _read_numbered(cursor: Cursor, commands: CommandGroups) -> None:
    """G1, M30, X10.5, R10=..., X1=...: a letter with digits."""
    token = cursor.token
    letter = token.text[0]
    if letter == "R":
        _read_assignment(cursor, token.text, read_r_parameter(cursor, read_expression))
    elif cursor.after.text == "=" and letter in _EXTENDED:
        cursor.take()
        _read_extended(cursor, token)
    else:
        cursor.take()
        _check_plain(token, letter, commands)


def _read_extended(cursor: Cursor, token: Token) -> None:
    if "." in token.text:
        raise IllegalBlock("E-LEGAL-NUMBER", text=token.text)
    cursor.expect("=")
    _read_address_value(cursor, token.text)


def _check_plain(token: Token, letter: str, commands: CommandGroups) -> None:
    if letter == "N":
        raise IllegalBlock("E-LEGAL-BLOCK-NUMBER", text=token.text)
    if letter == "G":
        _check_g_command(token, commands)
    elif letter in _WHOLE and "." in token.text:
        raise IllegalBlock("E-LEGAL-NUMBER", text=token.text)


def _check_g_command(token: Token, commands: CommandGroups) -> None:
    digits = token.text[1:]
    name = f"G{int(digits)}" if digits.isdigit() and len(digits) < 9 else token.text
    if name not in dictionary().commands:
        raise IllegalBlock("E-LEGAL-G-UNKNOWN", word=token.text)
    commands.note(name)


def _read_named(cursor: Cursor, commands: CommandGroups) -> None:
    text = cursor.token.text
    if text in cursor.scope.variables:
        before = _elements_before(cursor, cursor.scope.variables[text].sizes)
        _read_assignment(cursor, text, read_user_variable(cursor, read_expression), before)
    elif text == "R":
        _read_assignment(cursor, text, read_r_parameter(cursor, read_expression))
    elif text in cursor.scope.macros or text in _UNJUDGED:
        cursor.skip()
    elif text in cursor.scope.routines:
        read_call(cursor)
    else:
        _read_language_word(cursor, text, commands)


def _read_language_word(cursor: Cursor, text: str, commands: CommandGroups) -> None:
    lists = dictionary()
    if len(text) == 1:
        cursor.take()
        _read_letter(cursor, text)
    elif cursor.scope.is_axis(text):
        cursor.take()
        _read_required_value(cursor, text)
    elif text in lists.addresses or text == "AX":
        cursor.take()
        _read_address(cursor, text)
    elif text in lists.commands:
        cursor.take()
        commands.note(text)
    elif text in lists.procedures:
        read_call(cursor)
    else:
        raise _misplaced_word(cursor, text)


def _misplaced_word(cursor: Cursor, text: str) -> IllegalBlock:
    lists = dictionary()
    if text in lists.keywords:
        return IllegalBlock("E-LEGAL-PLACE", word=text)
    if text in lists.reserved:
        return cursor.wrong(Message.of("W-NC-BLOCK-WORD"))
    if cursor.after.text in ("=", "==", "["):
        return IllegalBlock("E-LEGAL-UNDEFINED", name=text)
    return IllegalBlock("E-LEGAL-WORD", word=text)


def _read_letter(cursor: Cursor, letter: str) -> None:
    """X=..., X -10, S[1]=..., F R1 (refused): a single address letter."""
    if letter in ("N", "L"):
        raise IllegalBlock("E-LEGAL-ASSIGN", name=letter, found=cursor.token.text or Message.of("W-NC-BLOCK-END"))
    if cursor.sees("="):
        _read_required_value(cursor, letter)
        return
    if cursor.sees("["):
        read_indices(cursor, letter, read_expression)
        _read_required_value(cursor, letter)
        return
    signed = cursor.sees("-", "+")
    number = cursor.after if signed else cursor.token
    if number.kind != "number":
        raise IllegalBlock("E-LEGAL-ASSIGN", name=letter, found=cursor.token.text or Message.of("W-NC-BLOCK-END"))
    for _ in range(1 + signed):
        cursor.take()


def _read_address(cursor: Cursor, name: str) -> None:
    """FA[X]=..., SPOS=..., DIAMOFA[X]: an address of several letters needs its equals sign."""
    if cursor.sees("["):
        read_indices(cursor, name, read_expression)
        if name.startswith(_WITHOUT_VALUE) and not cursor.sees("="):
            return
    _read_required_value(cursor, name)


def _read_required_value(cursor: Cursor, name: str) -> None:
    if not cursor.accept("="):
        raise IllegalBlock("E-LEGAL-ASSIGN", name=name, found=cursor.token.text or Message.of("W-NC-BLOCK-END"))
    _read_address_value(cursor, name)


def _read_address_value(cursor: Cursor, name: str) -> None:
    """An axis takes a number; other addresses take several in brackets too, an axis, a text."""
    if cursor.scope.is_axis(name) or name == "F":
        check_assignment("REAL", name, read_expression(cursor))
    elif cursor.sees("(") and len(cursor.arguments()) > 1:
        read_values(cursor)  # (1,2,3) is a list, (1+2)*3 one value that begins with a bracket
    else:
        read_expression(cursor)


# What a program declares at its head: DEF, PROC, EXTERN, DEFINE.

TYPES = frozenset({"INT", "REAL", "BOOL", "CHAR", "STRING", "AXIS", "FRAME"})
_MODIFIERS = frozenset({"NCK", "CHAN", "SYNR", "SYNW", "SYNRW", "INIPO", "INIRE", "INICF", "PRLOC"})
_NUMBERED = frozenset({"PHU", "APR", "APW", "APRP", "APWP", "APRB", "APWB"})
_MOST_SIZES = 3


def read_definition(cursor: Cursor) -> None:
    """DEF [range] type name[sizes][=value], ... Raises IllegalBlock; wrong names are noted and declared."""
    _skip_modifiers(cursor)
    kind, length = _read_type(cursor)
    while True:
        _read_variable(cursor, kind, length)
        if not cursor.accept(","):
            break
    while cursor.sees("LLI", "ULI"):
        cursor.take()
        read_expression(cursor)
    cursor.ended()


def read_procedure(cursor: Cursor) -> str:
    """PROC name(parameters) attributes. Returns the name."""
    if cursor.token.kind != "name":
        raise cursor.wrong("a name")
    name = cursor.take().text
    if cursor.accept("(") and not cursor.accept(")"):
        while True:
            cursor.accept("VAR")
            _read_variable(cursor, *_read_type(cursor))
            if not cursor.accept(","):
                break
        cursor.expect(")")
    cursor.skip()
    return name


def read_external(cursor: Cursor) -> None:
    """EXTERN name(types): a sub-program that is called by its name."""
    name = _read_name(cursor)
    cursor.scope.routines.add(name)
    cursor.skip()


def read_macro(cursor: Cursor) -> None:
    """DEFINE name AS ...: what follows is not judged."""
    name = _read_name(cursor)
    cursor.scope.macros.add(name)
    cursor.expect("AS")
    cursor.skip()


def _skip_modifiers(cursor: Cursor) -> None:
    while cursor.token.text in _MODIFIERS | _NUMBERED:
        if cursor.take().text in _NUMBERED:
            cursor.take()


def _read_type(cursor: Cursor) -> tuple[str, int]:
    token = cursor.token
    if token.text not in TYPES:
        raise IllegalBlock("E-LEGAL-DEF-TYPE", found=token.text or Message.of("W-NC-BLOCK-END"))
    cursor.take()
    return token.text, _read_text_length(cursor) if token.text == "STRING" else 0


def _read_text_length(cursor: Cursor) -> int:
    cursor.expect("[")
    digits = cursor.take().text
    if not digits.isdigit() or not 0 < int(digits[:9]) <= MAX_STRING:
        raise IllegalBlock("E-LEGAL-STRING-LENGTH", length=digits, limit=MAX_STRING)
    cursor.expect("]")
    return int(digits)


def _read_variable(cursor: Cursor, kind: str, length: int) -> None:
    name = _read_name(cursor)
    if name in cursor.scope.variables:
        cursor.noted.append(IllegalBlock("E-LEGAL-TWICE", name=name))
    sizes = _read_sizes(cursor, name)
    kept = name in dictionary().reserved or cursor.scope.is_axis(name)
    if len(name) == 1 or not kept:  # a word of the language stays what it is
        cursor.scope.variables[name] = Declared(kind, sizes, length)
    if cursor.accept("="):
        _read_initial_value(cursor, name, kind, length)


def _read_initial_value(cursor: Cursor, name: str, kind: str, length: int) -> None:
    if cursor.sees("SET", "REP"):
        repeated = cursor.take().text == "REP"
        given = read_values(cursor)
        check_list(cursor, name, given[:1] if repeated else given)
    elif cursor.sees("(") and len(cursor.arguments()) > 1:
        check_list(cursor, name, read_values(cursor))
    else:
        check_constant(cursor, name, kind, length)
        check_assignment(kind, name, read_expression(cursor))


def _read_sizes(cursor: Cursor, name: str) -> tuple[int, ...]:
    if not cursor.accept("["):
        return ()
    found: list[int] = []
    while True:
        digits = cursor.take().text
        if not digits.isdigit() or int(digits[:9]) == 0 or len(found) == _MOST_SIZES:
            raise IllegalBlock("E-LEGAL-INDEX-VALUE", name=name, value=digits)
        found.append(int(digits[:9]))
        if not cursor.accept(","):
            break
    cursor.expect("]")
    return tuple(found)


def _read_name(cursor: Cursor) -> str:
    """A name as it is written, letters and digits that the lexer parted put together again."""
    token = cursor.token
    if token.kind not in ("name", "din"):
        raise cursor.wrong("a name")
    text = cursor.take().text
    while cursor.token.kind in ("name", "din") and cursor.token.column == token.column + len(text):
        text += cursor.take().text
    try:
        check_name(text, "variable")
    except IllegalBlock as wrong:
        cursor.noted.append(wrong)
    return text
