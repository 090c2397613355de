"""IF, FOR, WHILE, LOOP and REPEAT: every one closed, by its own word, in order, not too deep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from drivers.sinumerik.legality.findings import Finding, Illegal, finding

DEEPEST = 16
CLOSED_BY = {"IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "LOOP": "ENDLOOP", "REPEAT": "UNTIL"}
_OPENED_BY = {closer: opener for opener, closer in CLOSED_BY.items()}
WORDS = frozenset(CLOSED_BY) | frozenset(_OPENED_BY) | {"ELSE"}


class Open(NamedTuple):
    """A structure that stands open: its word, its line, 1 behind ELSE."""

    word: str
    line: int
    branch: int


Path = tuple[Open, ...]


def judge(events: Sequence[tuple[int, str]]) -> tuple[list[Path], list[Finding]]:
    """The structures that are open behind each (line, word), and what is wrong with them."""
    stack: list[Open] = []
    paths: list[Path] = []
    findings: list[Finding] = []
    for line, word in events:
        findings += [finding(place, wrong) for place, wrong in _step(stack, line, word)]
        paths.append(tuple(stack))
    findings += [finding(left.line, _unclosed(left)) for left in stack]
    return paths, findings


def _step(stack: list[Open], line: int, word: str) -> Iterator[tuple[int, Illegal]]:
    if word in CLOSED_BY:
        stack.append(Open(word, line, 0))
        if len(stack) > DEEPEST:
            yield line, Illegal("E-LEGAL-DEPTH", depth=len(stack), limit=DEEPEST)
    elif word == "ELSE":
        yield from _else(stack, line)
    elif word in _OPENED_BY:
        yield from _close(stack, line, word)


def _else(stack: list[Open], line: int) -> Iterator[tuple[int, Illegal]]:
    if not stack or stack[-1].word != "IF" or stack[-1].branch:
        yield line, Illegal("E-LEGAL-ELSE")
    else:
        stack[-1] = stack[-1]._replace(branch=1)


def _close(stack: list[Open], line: int, word: str) -> Iterator[tuple[int, Illegal]]:
    """Close the nearest structure of this kind; what stands open inside it was forgotten."""
    opener = _OPENED_BY[word]
    if not any(item.word == opener for item in stack):
        yield line, Illegal("E-LEGAL-CLOSE", word=word, opener=opener)
        return
    while stack[-1].word != opener:
        left = stack.pop()
        yield left.line, _unclosed(left)
    stack.pop()


def _unclosed(left: Open) -> Illegal:
    return Illegal("E-LEGAL-UNCLOSED", word=left.word, closer=CLOSED_BY[left.word])
