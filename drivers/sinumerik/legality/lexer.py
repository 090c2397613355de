"""The lexical level: findings, the rules of names, one line cut into tokens, and a cursor over them.

Every other module of the checker reads through `Cursor` and reports by raising `IllegalBlock`; `make_finding` gives
the error its line. A comment is no token. Letter and digits of a DIN word (``X10``, ``G1``) are one token, a letter
before ``=`` or a bracket is a name.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from drivers.errors import LocalProtocolError, words
from drivers.message import Message
from drivers.sinumerik.legality.dictionary import dictionary


class IllegalBlock(LocalProtocolError):
    """One block breaks one rule; never leaves this room."""


@dataclass(frozen=True, order=True)
class Finding:
    """One broken rule: the line (from 1; 0 is the program's name), the rule's code, what is wrong, what to do."""

    line: int
    code: str
    what: str
    do: str

    @property
    def words(self) -> str:
        """Line, what, rule and next step in one sentence."""
        return words("P-LEGAL-LINE", line=self.line, what=self.what, do=self.do)


def make_finding(line: int, error: IllegalBlock) -> Finding:
    """The broken rule with its place."""
    return Finding(line, error.code, error.what, error.hint)


# Names of user variables, labels, programs and files of the control's own file system.

LONGEST = {"variable": 31, "label": 32, "program": 24, "axis": 8}  # printed
_FIRST = re.compile(r"[A-Z_]{2}[A-Z0-9_]*", re.ASCII)
_PROGRAM = re.compile(r"(?:[A-Z]{2}|_[A-Z])[A-Z0-9_]*", re.ASCII)
_RESERVED_PREFIXES = ("CYCLE", "CCS", "CC_", "CUST_", "GROUP_", "S_", "E_", "F_", "_")
_RESERVED_NAMES = frozenset({"RL"})
_DEVICES = re.compile(r"CON|PRN|AUX|NUL|COM[1-9]|LPT[1-9]")
_FILE = re.compile(r"(?:_N_)?(?P<name>.*?)(?:[._](?P<extension>MPF|SPF|WPF|INI|DEF|GUD|TEA|UFR|TOA|EEC|CEC))?")
_FOLDER = re.compile(r"(?:_N_)?[A-Z0-9_]+[._](?:DIR|WPD)", re.ASCII)
AXIS_LETTERS = frozenset("ABCEIJKQUVWXYZ")  # printed: the address letters that take a number
_NUMBERED_AXIS = re.compile(r"(?:[ABCEIJKQUVWXYZ][1-9]?[0-9]?|AX[1-9][0-9]?|S[0-9]{1,2})")


def check_name(name: str, kind: str) -> None:
    """Raise IllegalBlock unless ``name`` (in capitals) may be a user's name of this kind (variable, label)."""
    if not _FIRST.fullmatch(name):
        raise IllegalBlock("E-LEGAL-NAME", name=name, kind=kind)
    _check_length(name, kind)
    _check_reserved(name, kind)


def check_program_name(name: str) -> None:
    """Raise IllegalBlock unless a program may be called so; with or without _N_ and extension, no path."""
    bare = bare_name(name)
    if not _PROGRAM.fullmatch(bare):
        raise IllegalBlock("E-LEGAL-PROGRAM-NAME", name=name)
    _check_length(bare, "program")
    if _DEVICES.fullmatch(bare):
        raise IllegalBlock("E-LEGAL-DEVICE-NAME", name=name)
    _check_reserved(bare, "program")


def check_file_name(text: str) -> None:
    """Raise IllegalBlock unless ``text`` names a file of the control: [path/][_N_]name[_MPF]; words are allowed."""
    *folders, last = text.upper().split("/")
    if folders and folders[0]:
        raise IllegalBlock("E-LEGAL-FILE-NAME", name=text)  # printed: paths are absolute
    bare = bare_name(last)
    if any(not _FOLDER.fullmatch(folder) for folder in folders[1:]) or not _PROGRAM.fullmatch(bare):
        raise IllegalBlock("E-LEGAL-FILE-NAME", name=text)
    _check_length(bare, "program")


def bare_name(name: str) -> str:
    """The name itself in capitals: without _N_, without extension."""
    match = _FILE.fullmatch(name.upper())
    return match["name"] if match else name.upper()


@functools.lru_cache(maxsize=512)
def looks_like_axis(name: str) -> bool:
    """An address letter with or without a number (X, X1, A12), AXn, or a spindle S1."""
    return _NUMBERED_AXIS.fullmatch(name) is not None


def _check_length(name: str, kind: str) -> None:
    if len(name) > LONGEST[kind]:
        raise IllegalBlock("E-LEGAL-NAME-LENGTH", name=name, kind=kind, length=len(name), limit=LONGEST[kind])


def _check_reserved(name: str, kind: str) -> None:
    if name in dictionary().reserved or name in _RESERVED_NAMES or looks_like_axis(name):
        raise IllegalBlock("E-LEGAL-RESERVED", name=name, kind=kind)
    for prefix in _RESERVED_PREFIXES:
        if name.startswith(prefix):
            raise IllegalBlock("E-LEGAL-PREFIX", name=name, kind=kind, prefix=prefix)


# One line into tokens: words, numbers, strings, operators; a comment is no token.

MAX_STRING = 200  # printed: a string holds at most 200 characters
_DEEPEST = 40  # brackets in brackets: nothing that is meant to be read has more
_SMALLEST_EXPONENT, _LARGEST_EXPONENT = -324, 308


class Token(NamedTuple):
    """A kind (din, name, variable, number, constant, string, op, end), its text in capitals, its first column."""

    kind: str
    text: str
    column: int


_TOKEN = re.compile(
    r"""(?P<space>[\x00-\x20\x7f&]+)
      | (?P<comment>;.*)
      | (?P<string>"[^"]*")
      | (?P<variable>\$[A-Z_][A-Z0-9_]*)
      | (?P<din>[A-Z](?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))
      | (?P<name>[A-Z_][A-Z0-9_]*)
      | (?P<constant>'(?:H[0-9A-F]+|B[01]+)')
      | (?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:EX[-+]?[0-9]+)?)
      | (?P<op><<|>=|<=|==|<>|[-+*/=<>()\[\],:])
      | (?P<bad>.)""",
    re.VERBOSE | re.IGNORECASE | re.ASCII | re.DOTALL,
)
_WORDLIKE = frozenset({"din", "name", "number", "variable"})
_CLOSES = {")": "(", "]": "["}
_KEPT_LINES = 4096


@functools.lru_cache(maxsize=_KEPT_LINES)
def tokenize(line: str) -> tuple[Token, ...]:
    """Cut one line; ends with an "end" token. Raises IllegalBlock for what cannot be cut.

    Generators write the same lines into one program after the other, and two sides judge each: a line is cut once.
    """
    found: list[Token] = []
    before = ""
    for match in _TOKEN.finditer(line):
        kind = match.lastgroup or "bad"
        if kind in ("space", "comment"):
            before = ""
            continue
        text = match[0]
        if kind == "string":
            _check_string(text[1:-1])
        else:
            text = text.upper()
            _check_token(kind, text, before)
        found.append(Token(kind, text, match.start()))
        before = kind
    _check_brackets(found)
    found.append(Token("end", "", len(line)))
    return tuple(found)


def _check_token(kind: str, text: str, before: str) -> None:
    if kind == "bad":
        raise _stray_character(text)
    if before == "number" and kind in _WORDLIKE:
        raise IllegalBlock("E-LEGAL-NUMBER", text=text)  # 1E5, 1.2.3, 5_000
    if kind == "number":
        if before in ("din", "name"):
            raise IllegalBlock("E-LEGAL-NUMBER", text=text)  # X1.2.3
        _check_exponent(text)


def _stray_character(text: str) -> IllegalBlock:
    if text == '"':
        return IllegalBlock("E-LEGAL-STRING")
    if text in ".'":
        return IllegalBlock("E-LEGAL-NUMBER", text=text)
    return IllegalBlock("E-LEGAL-CHARACTER", character=text)


def _check_string(inside: str) -> None:
    if len(inside) > MAX_STRING:
        raise IllegalBlock("E-LEGAL-STRING-LENGTH", length=len(inside), limit=MAX_STRING)
    for character in inside:
        if ord(character) > 255:
            raise IllegalBlock("E-LEGAL-CHARACTER", character=character)


def _check_exponent(text: str) -> None:
    _, found, exponent = text.partition("EX")
    if found and not _SMALLEST_EXPONENT < int(exponent[:9]) <= _LARGEST_EXPONENT:
        raise IllegalBlock("E-LEGAL-NUMBER", text=text)


def _check_brackets(found: list[Token]) -> None:
    stack: list[Token] = []
    for token in found:
        if token.kind != "op":
            continue
        if token.text in "([":
            stack.append(token)
            if len(stack) > _DEEPEST:
                raise IllegalBlock("E-LEGAL-BRACKET-DEPTH", depth=len(stack), limit=_DEEPEST)
        elif token.text in _CLOSES and (not stack or stack.pop().text != _CLOSES[token.text]):
            raise IllegalBlock("E-LEGAL-BRACKET", bracket=token.text, column=token.column + 1)
    if stack:
        raise IllegalBlock("E-LEGAL-BRACKET", bracket=stack[-1].text, column=stack[-1].column + 1)


# A place in one block's tokens, and what the program has declared so far.


@dataclass(frozen=True)
class Declared:
    """A user's variable: its type, sizes of its array, longest text of a STRING (0: no STRING)."""

    type: str
    sizes: tuple[int, ...] = ()
    length: int = 0


@dataclass
class Scope:
    """What a program may name beside the language: its variables, macros and sub-programs, the machine's axes."""

    axes: frozenset[str] = frozenset()
    variables: dict[str, Declared] = field(default_factory=dict)
    routines: set[str] = field(default_factory=set)
    macros: set[str] = field(default_factory=set)

    def is_axis(self, name: str) -> bool:
        """An axis of this machine, or a name that the language keeps for axes."""
        return name in self.axes or looks_like_axis(name)


class Cursor:
    """Walks the tokens of one block; never past the "end" token."""

    def __init__(self, found: Sequence[Token], scope: Scope, at: int = 0) -> None:
        self._tokens = found
        self._at = at
        self.scope = scope
        self.noted: list[IllegalBlock] = []  # what is wrong but leaves the rest of the block readable

    @property
    def token(self) -> Token:
        """The token that stands next."""
        return self._tokens[self._at]

    @property
    def after(self) -> Token:
        """The token behind it."""
        return self._tokens[min(self._at + 1, len(self._tokens) - 1)]

    @property
    def at_end(self) -> bool:
        """True where the block has no more words."""
        return self.token.kind == "end"

    def take(self) -> Token:
        """Step over the next token and return it."""
        token = self._tokens[self._at]
        if token.kind != "end":
            self._at += 1
        return token

    def sees(self, *texts: str) -> bool:
        """True if an operator or word of these stands next."""
        token = self._tokens[self._at]
        return token.text in texts and token.kind in ("op", "name")

    def accept(self, text: str) -> bool:
        """Step over ``text`` if it stands next."""
        if not self.sees(text):
            return False
        self._at += 1
        return True

    def expect(self, text: str) -> None:
        """Step over ``text``. Raises IllegalBlock if something else stands there."""
        if not self.accept(text):
            raise self.wrong(text)

    def fork(self) -> Cursor:
        """Another cursor at the same place, to look ahead."""
        return Cursor(self._tokens, self.scope, self._at)

    def arguments(self) -> list[list[Token]]:
        """The tokens of each value of the call whose opening bracket stands next; nothing is stepped over."""
        parts: list[list[Token]] = [[]]
        depth = 0
        for token in self._tokens[self._at :]:
            depth += (token.text in ("(", "[")) - (token.text in (")", "]"))
            if depth == 0:
                break
            if depth == 1 and token.text == ",":
                parts.append([])
            elif depth > 1 or token.text != "(":
                parts[-1].append(token)
        return parts

    def ended(self) -> None:
        """Raise IllegalBlock unless the block ends here."""
        if not self.at_end:
            raise self.wrong(Message.of("W-NC-BLOCK-END"))

    def wrong(self, wanted: str | Message) -> IllegalBlock:
        """The error for a token that does not belong here."""
        return IllegalBlock("E-LEGAL-SYNTAX", found=self.token.text or Message.of("W-NC-BLOCK-END"), wanted=wanted)

    def skip(self) -> None:
        """Leave the rest of the block unjudged."""
        self._at = len(self._tokens) - 1
