"""Nobody decides by the code or the beginning of a text: classes, enums and fields say what is to be done.

A code is the name of a text. What follows from a message, error or progress follows from its class (`gateway.events`,
the exceptions, `FindingKind`, `Audience`). The numbers below are exactly what is left: they only shrink, and with each
decision that goes its number here is lowered.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import re
from collections import Counter
from pathlib import Path
from typing import get_type_hints

from tests.architecture.sources import nodes

ROOT = Path(__file__).parents[2]
CODE = re.compile(r"^[ENPRSW]-[A-Z0-9]*[A-Z0-9-]*$")
LITERAL = re.compile(r'"[ENPRSW]-[A-Z0-9]+(?:-[A-Z0-9]+)*"')
LEFT: dict[str, int] = {
    "gateway/acceptance": 1,
    "gateway/cli": 10,
    "gateway/config": 1,
    "gateway/evaluate": 6,
    "gateway/domain": 1,  # what a sentence in a record of an older version meant
    "gateway/push": 3,
    "gateway/watch": 1,
    "gateway/workflow": 12,
    "drivers/bridge": 8,  # six of them codes of the bridge's own protocol
    "drivers/files": 1,
    "drivers/linuxcnc": 5,
    "drivers/manual": 1,
    "drivers/sinumerik": 15,
    "drivers/umd": 1,
    "trueflank/measuring.py": 2,
}
"""Decisions left, by package."""
LEFT_ON_PAGE = 1
"""Codes named in the scripts of the page: E-WEB-LOGIN, which asks for a new sign-in; an answer has no class there."""
WORDY = re.compile(r"^(?:words|said|notes|flags|steps|reasons|findings|warnings|why|skipped|marker|text)$")


def _is_code(node: ast.AST) -> bool:
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str) and CODE.match(node.value) is not None
    if isinstance(node, (ast.Tuple, ast.List, ast.Set)):
        return bool(node.elts) and all(_is_code(one) for one in node.elts)
    return isinstance(node, ast.Attribute) and node.attr == "code"


def _decides(node: ast.AST) -> bool:
    """A comparison with a code, or a text looked at by how it begins as a code does."""
    if isinstance(node, ast.Compare):
        return any(_is_code(one) for one in (node.left, *node.comparators))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
        return node.func.attr in ("startswith", "endswith") and _is_code(node.args[0])
    return False


def _found() -> Counter[str]:
    found: Counter[str] = Counter()
    for top in ("gateway", "drivers", "trueflank"):
        for path in sorted((ROOT / top).rglob("*.py")):
            place = path.relative_to(ROOT).parts
            package = "/".join(place[:2]) if len(place) > 2 else str(Path(*place))
            found[package] += sum(_decides(node) for node in nodes(path, ast.Compare, ast.Call))
    return +found


def test_no_control_flow_reads_a_code_or_a_text() -> None:
    assert dict(_found()) == LEFT, "more than before, or fewer: then lower LEFT"


def test_the_page_decides_by_events() -> None:
    files = sorted((ROOT / "gateway" / "web" / "page").glob("*.js"))
    assert sum(len(LITERAL.findall(path.read_text(encoding="utf-8"))) for path in files) == LEFT_ON_PAGE


def _wordy_fields() -> frozenset[str]:
    found = set()
    for module in ("outcomes", "captures", "figures", "proposals", "stated"):
        for item in vars(importlib.import_module(f"gateway.domain.{module}")).values():
            found |= _of(item, f"gateway.domain.{module}")
    for item in vars(importlib.import_module("gateway.tooth")).values():
        found |= _of(item, "gateway.tooth")
    return frozenset(found)


def _of(item: object, module: str) -> set[str]:
    if not (isinstance(item, type) and dataclasses.is_dataclass(item) and item.__module__ == module):
        return set()
    hints = get_type_hints(item)
    texts = (str, tuple[str, ...])
    return {
        f"{item.__name__}.{one.name}"
        for one in dataclasses.fields(item)
        if WORDY.match(one.name) and hints[one.name] in texts
    }


def test_records_contain_messages() -> None:
    assert _wordy_fields() == frozenset(), "a record contains messages, never sentences"
