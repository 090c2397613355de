"""A place in one block's tokens, and what the program has declared so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.lexer import Token
from drivers.sinumerik.legality.names import looks_like_axis


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
        self.noted: list[Illegal] = []  # what is wrong but leaves the rest of the block readable

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
        """Step over ``text``. Raises Illegal if something else stands there."""
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
        """Raise Illegal unless the block ends here."""
        if not self.at_end:
            raise self.wrong("the end of the block")

    def wrong(self, wanted: str) -> Illegal:
        """The error for a token that does not belong here."""
        return Illegal("E-LEGAL-SYNTAX", found=self.token.text or "the end of the block", wanted=wanted)

    def skip(self) -> None:
        """Leave the rest of the block unjudged."""
        self._at = len(self._tokens) - 1
