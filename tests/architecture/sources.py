"""Sources as syntax trees, each parsed and walked once for all tests of the architecture."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TypeVar

T = TypeVar("T", bound=ast.AST)


@cache
def parsed(path: Path) -> ast.Module:
    """The tree of one file; nobody may change it."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _by_kind(path: Path) -> dict[type[ast.AST], list[ast.AST]]:
    found: dict[type[ast.AST], list[ast.AST]] = defaultdict(list)
    for node in ast.walk(parsed(path)):
        found[type(node)].append(node)
    return found


def nodes(path: Path, *kinds: type[T]) -> Iterator[T]:
    """Every node of one file that is of these kinds, kind by kind: a walk through all of it is slow, and done once."""
    kept = _by_kind(path)
    for kind in kinds:
        yield from kept.get(kind, ())  # type: ignore[misc] - what stands under a kind is of that kind
