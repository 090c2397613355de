"""One block of NC text -> its nodes, within limits of length and depth."""

from __future__ import annotations

import functools

import lark

from simulators.nck.language.nodes import NodeRefused, Nodes
from simulators.nck.language.rules import GRAMMAR
from simulators.nck.language.syntax import Block, NcSyntaxError

BLOCK_LIMIT = 512
DEPTH_LIMIT = 60


class _Builder(Nodes, lark.Transformer):
    """The parser calls it while it reads."""


@functools.cache
def _parser() -> lark.Lark:
    return lark.Lark(GRAMMAR, parser="lalr", lexer="contextual", transformer=_Builder(), maybe_placeholders=True)


@functools.lru_cache(maxsize=4096)
def _read(text: str) -> Block:
    """Parse, once for each text: programs repeat themselves, and nodes are frozen."""
    block: Block = _parser().parse(text)
    return block


def _too_deep(text: str) -> bool:
    depth = deepest = run = longest = 0
    for sign in text:
        if sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        run = run + 1 if sign in "+-" else 0 if sign != " " else run
        deepest, longest = max(deepest, depth), max(longest, run)
    return deepest > DEPTH_LIMIT or longest > DEPTH_LIMIT or text.count("NOT") > DEPTH_LIMIT


def parse_block(text: str, line: int = 1) -> Block:
    """Parse one block: upper case outside strings, without comment, number and label.

    Raises NcSyntaxError (with ``line``) when the text is no block of the subset, too long or too deep.
    """
    if len(text) > BLOCK_LIMIT or _too_deep(text):
        raise NcSyntaxError(line, "block is too long or too complex", 12540)
    try:
        return _read(text)
    except lark.exceptions.VisitError as error:
        raise _translated(error.orig_exc, line) from error
    except NodeRefused as error:
        raise _translated(error, line) from error
    except lark.exceptions.UnexpectedInput as error:
        column = error.column if isinstance(error.column, int) else 0
        near = text[max(column - 1, 0) : max(column - 1, 0) + 20] if column > 0 else "end of block"
        raise NcSyntaxError(line, f"syntax error at {near!r}") from error


def _translated(error: Exception, line: int) -> NcSyntaxError:
    if isinstance(error, NodeRefused):
        return NcSyntaxError(line, error.reason, error.number)
    return NcSyntaxError(line, f"syntax error: {error}")
