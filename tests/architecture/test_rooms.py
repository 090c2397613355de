"""Every room says what it is for, every public name is documented, and nothing unfinished stands in the source."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from tests.architecture.sources import parsed

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    path for package in ("gateway", "drivers", "simulators", "trueflank") for path in (ROOT / package).rglob("*.py")
)
FORBIDDEN_NAMES = {"manager", "helper", "helpers", "util", "utils", "common", "misc", "base"}


def _public(place: ast.Module | ast.ClassDef) -> list[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]:
    found: list[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef] = []
    for node in place.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and node.name[0] != "_":
            found.append(node)
            if isinstance(node, ast.ClassDef):
                found += _public(node)
    return found


def test_rooms_say_their_responsibility_and_document_what_is_public() -> None:
    wrong = [f"{path.relative_to(ROOT)}: {what}" for path in MODULES for what in _unsaid(path)]
    assert not wrong, "\n".join(wrong)


def _unsaid(path: Path) -> list[str]:
    """What a module leaves unsaid about itself, in words."""
    tree = parsed(path)
    found = [f"no room is called {path.stem}"] if path.stem in FORBIDDEN_NAMES else []
    found += [] if ast.get_docstring(tree) else ["says not what it is for"]
    public = [node for node in _public(tree) if (node.end_lineno or 0) - node.lineno > 3]
    return found + [f"{node.name} is not documented" for node in public if not ast.get_docstring(node)]


def test_no_unfinished_work_is_left_in_the_source() -> None:
    marks = re.compile(r"\b(TODO|FIXME|XXX)\b|NotImplementedError|pragma: no cover|# type: ignore(?!\[)")
    found = [str(path) for path in MODULES if marks.search(path.read_text(encoding="utf-8"))]
    assert not found


def test_every_pinned_package_has_a_version_and_no_index_address_stands_anywhere() -> None:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line.strip()]
    assert all(re.fullmatch(r"[A-Za-z0-9_.\-\[\]]+==[^=\s]+", line) for line in lines)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = project["project"]["dependencies"] + project["project"]["optional-dependencies"]["dev"]
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in lines}
    names = {re.split(r"[<>=\[ ]", item)[0].lower().replace("_", "-") for item in wanted}
    assert names <= pinned


def test_help_does_not_load_what_it_does_not_need() -> None:
    code = "import gateway.cli, sys; print([m for m in ('numpy','scipy','asyncua','matplotlib') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
