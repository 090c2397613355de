"""Sources as syntax trees, each parsed once for all tests of the house."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """The tree of one file; nobody may change it."""
    return ast.parse(path.read_text(encoding="utf-8"))
