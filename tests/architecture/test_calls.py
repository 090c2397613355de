"""Who is called with many values says which is which; a class name says one thing in its package."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.architecture.sources import parsed

ROOT = Path(__file__).parents[2]
TOPS = ("gateway", "drivers", "simulators", "trueflank")
MOST = 4
BODIES = ("body", "orelse", "finalbody", "handlers", "cases")
FOREIGN = {"add_method", "SinumerikSession", "draw_clamping"}
"""Signatures that are not ours (asyncua's), and one that takes any number of names."""
LEFT = {}
"""Rooms that still call with more, and how often at most: these numbers only shrink."""


@cache
def _sources() -> dict[str, str]:
    paths = (path for top in TOPS for path in sorted((ROOT / top).rglob("*.py")))
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}


def _ours() -> set[str]:
    code = "\n".join(_sources().values())
    return set(re.findall(r"^\s*(?:async def|def|class) ([A-Za-z]\w*)", code, re.MULTILINE)) - FOREIGN


def _statements(place: str) -> Iterator[ast.stmt]:
    """Simple statements and headers that hold enough commas for a call with more than four positions."""
    lines, ahead = _sources()[place].splitlines(), list[ast.AST](parsed(ROOT / place).body)
    while ahead:
        node = ahead.pop()
        inside = [one for name in BODIES for one in getattr(node, name, ())]
        ahead += inside
        if isinstance(node, ast.stmt):
            last = min((one.lineno for one in inside if isinstance(one, ast.stmt)), default=node.end_lineno)
            if sum(line.count(",") for line in lines[node.lineno - 1 : last]) >= MOST:
                yield node


def _calls(node: ast.AST) -> Iterator[ast.Call]:
    """Every call of a statement, without those of the statements inside it."""
    ahead = [node]
    while ahead:
        one = ahead.pop()
        if isinstance(one, ast.Call):
            yield one
        ahead += [child for child in ast.iter_child_nodes(one) if not isinstance(child, ast.stmt | ast.excepthandler)]


def _long_calls() -> Iterator[tuple[str, str]]:
    ours = _ours()
    for place in _sources():
        for call in (found for node in _statements(place) for found in _calls(node) if len(found.args) > MOST):
            name = call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")
            if name in ours:
                yield place, f"{place}:{call.lineno} {name} with {len(call.args)}"


def test_nothing_public_is_built_or_called_by_more_than_four_positions() -> None:
    found: dict[str, list[str]] = defaultdict(list)
    for place, words in _long_calls():
        found[next((room for room in LEFT if place.startswith(f"{room}/")), "")].append(words)
    assert found.pop("", []) == [], "name the arguments"
    assert {room: words for room, words in found.items() if len(words) > LEFT[room]} == {}


def test_a_class_name_is_unique_in_its_package() -> None:
    homes: dict[tuple[str, str], list[str]] = defaultdict(list)
    for place, code in _sources().items():
        package = place.rpartition("/")[0]
        for name in re.findall(r"^class ([A-Za-z]\w*)", code, re.MULTILINE):
            homes[package, name].append(place)
    assert {names: places for names, places in homes.items() if len(places) > 1} == {}
