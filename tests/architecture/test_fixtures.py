"""A fixture that several files need stands once, in a conftest.py."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]


def _fixtures(path: Path) -> list[str]:
    found = [node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)]
    return [ast.unparse(node) for node in found if any("fixture" in ast.unparse(one) for one in node.decorator_list)]


def test_no_fixture_is_written_twice() -> None:
    written = Counter(text for path in TESTS.rglob("*.py") for text in set(_fixtures(path)))
    assert [text for text, files in written.items() if files > 1] == []
