"""A rule that a block breaks: raised where it is noticed, kept with its line."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import LocalProtocolError, words


class Illegal(LocalProtocolError):
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


def finding(line: int, error: Illegal) -> Finding:
    """The broken rule with its place."""
    return Finding(line, error.code, error.what, error.hint)
