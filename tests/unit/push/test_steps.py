"""Every step that a push writes into its journal has words for people, and no name in capitals reaches them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from gateway.push.records.steps import SAID, step_words

PUSH = Path(__file__).parents[3] / "gateway" / "push"


def _kinds() -> Iterator[str]:
    """First arguments of `note` and `append` in capitals."""
    for path in PUSH.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("note", "append") and node.args:
                first = node.args[0]
                found = (first.body, first.orelse) if isinstance(first, ast.IfExp) else (first,)
                yield from (
                    str(one.value) for one in found if isinstance(one, ast.Constant) and str(one.value).isupper()
                )


def test_every_kind_of_a_journal_has_words_without_capitals() -> None:
    kinds = set(_kinds())
    assert len(kinds) > 20
    assert sorted(kinds - set(SAID)) == []
    assert [kind for kind in sorted(kinds) if step_words(kind).upper() == step_words(kind)] == []


def test_a_kind_of_another_version_is_told_in_plain_letters() -> None:
    assert step_words("NEVER_HEARD_OF") == "never heard of"
