"""One line into tokens: words, numbers, strings, operators; a comment is no token."""

from __future__ import annotations

import re
from typing import NamedTuple

from drivers.sinumerik.legality.findings import Illegal

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


def tokens(line: str) -> list[Token]:
    """Cut one line; ends with an "end" token. Raises Illegal for what cannot be cut."""
    found: list[Token] = []
    before = ""
    for match in _TOKEN.finditer(line):
        kind = match.lastgroup or "bad"
        if kind in ("space", "comment"):
            before = ""
            continue
        text = match[0]
        if kind == "string":
            _judge_string(text[1:-1])
        else:
            text = text.upper()
            _judge(kind, text, before)
        found.append(Token(kind, text, match.start()))
        before = kind
    _judge_brackets(found)
    found.append(Token("end", "", len(line)))
    return found


def _judge(kind: str, text: str, before: str) -> None:
    if kind == "bad":
        raise _stray(text)
    if before == "number" and kind in _WORDLIKE:
        raise Illegal("E-LEGAL-NUMBER", text=text)  # 1E5, 1.2.3, 5_000
    if kind == "number":
        if before in ("din", "name"):
            raise Illegal("E-LEGAL-NUMBER", text=text)  # X1.2.3
        _judge_exponent(text)


def _stray(text: str) -> Illegal:
    if text == '"':
        return Illegal("E-LEGAL-STRING")
    if text in ".'":
        return Illegal("E-LEGAL-NUMBER", text=text)
    return Illegal("E-LEGAL-CHARACTER", character=text)


def _judge_string(inside: str) -> None:
    if len(inside) > MAX_STRING:
        raise Illegal("E-LEGAL-STRING-LENGTH", length=len(inside), limit=MAX_STRING)
    for character in inside:
        if ord(character) > 255:
            raise Illegal("E-LEGAL-CHARACTER", character=character)


def _judge_exponent(text: str) -> None:
    _, found, exponent = text.partition("EX")
    if found and not _SMALLEST_EXPONENT < int(exponent[:9]) <= _LARGEST_EXPONENT:
        raise Illegal("E-LEGAL-NUMBER", text=text)


def _judge_brackets(found: list[Token]) -> None:
    stack: list[Token] = []
    for token in found:
        if token.kind != "op":
            continue
        if token.text in "([":
            stack.append(token)
            if len(stack) > _DEEPEST:
                raise Illegal("E-LEGAL-BRACKET-DEPTH", depth=len(stack), limit=_DEEPEST)
        elif token.text in _CLOSES and (not stack or stack.pop().text != _CLOSES[token.text]):
            raise Illegal("E-LEGAL-BRACKET", bracket=token.text, column=token.column + 1)
    if stack:
        raise Illegal("E-LEGAL-BRACKET", bracket=stack[-1].text, column=stack[-1].column + 1)
