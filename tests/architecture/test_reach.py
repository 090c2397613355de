"""What tests judge is what runs: every module is reached from an entry point."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
TOPS = ("gateway", "drivers", "simulators", "trueflank")
ENTRIES = (
    "gateway.cli.__main__",
    "gateway.daemon",
    "simulators.cell.__main__",
    "simulators.gauge",
    "simulators.reducer.__main__",
    "gateway.acceptance.pytest_plugin",
    "gateway.acceptance.suite",
    "simulators.pytest_plugin",
    "drivers.registry",
    "drivers.linuxcnc.agent.__main__",
    "drivers.contract",
    "trueflank",
)
PURE = ("evaluate", "correct", "model", "gear", "sensitivity", "guard")
ALONE = {
    "cosine_error_mm": "a worked case; no step of a run takes it off",
    "drift_removed": "a worked case; the run levels passes and judges steadiness instead",
    "from_face_diagonals": "a worked case; no set-up measures diagonals",
    "parallel": "a worked case of two straightness runs",
    "sensitivities": "a worked case of the refractive index",
    "from_rows": "tables of readings by hand",
    "observability": "a worked case of what the flank shows",
    "exhaustive": "worked cases of the Morris indices, which sampling meets at best nearly",
    "records_of_product": "product tables wait for their proof on a machine",
    "good_enough": "the bound on the first order",
}
"""Public functions of the pure rooms that no product module names, and why they stay: this list only shrinks."""


FROM = re.compile(r"^[ ]*from ([\w.]+) import (\([^)]*\)|.+)$", re.MULTILINE)
IMPORT = re.compile(r"^[ ]*import ([\w.]+)", re.MULTILINE)
LATE = re.compile(r'"((?:gateway|drivers|simulators)[\w.]*)(?::\w+)?"')
DOCSTRING = re.compile(r'"""[\s\S]*?"""')


@cache
def _sources() -> dict[str, str]:
    """Every module's code without its docstrings, by its name."""
    found = {}
    for top in TOPS:
        for path in sorted((ROOT / top).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = DOCSTRING.sub('""', path.read_text(encoding="utf-8"))
    found["gateway.cli.command_list"] += (ROOT / "gateway" / "cli" / "order.toml").read_text(encoding="utf-8")
    return found


def _named(code: str) -> Iterator[str]:
    """Everything a module imports, by statement or as the text "module" or "module:attribute" that is loaded late."""
    yield from IMPORT.findall(code)
    yield from LATE.findall(code)
    for module, names in FROM.findall(code):
        yield module
        yield from (f"{module}.{name}" for name in re.findall(r"\w+", names))


@cache
def _imports() -> dict[str, set[str]]:
    modules = _sources()
    return {name: {other for other in _named(code) if other in modules} - {name} for name, code in modules.items()}


def _reached() -> set[str]:
    seen: set[str] = set()
    ahead = list(ENTRIES)
    while ahead:
        name = ahead.pop()
        if name in seen:
            continue
        seen.add(name)
        ahead += _imports()[name]
        ahead += [name.rpartition(".")[0]] if "." in name else []
    return seen


def test_every_module_is_reached_from_an_entry_point() -> None:
    assert sorted(set(_sources()) - _reached()) == [], "nothing but tests reaches these: take them out"


def _definitions(code: str) -> Iterator[str]:
    for node in ast.parse(code).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name
        if isinstance(node, ast.ClassDef):
            yield from (item.name for item in node.body if isinstance(item, ast.FunctionDef) and item.name[0] != "_")


def test_public_functions_of_the_pure_rooms_are_named_by_the_product() -> None:
    words = Counter(word for code in _sources().values() for word in re.findall(r"\b\w+\b", code))
    rooms = tuple(f"gateway.{room}" for room in PURE)
    judged = [code for name, code in _sources().items() if name.startswith(rooms)]
    names = {name for code in judged for name in _definitions(code)}
    assert sorted(name for name in names if words[name] == 1) == sorted(ALONE)
