"""Mutants of the packages that decide about a write: each is one small fault, which the tests of its package must find.

`python -m tests.mutants SEED COUNT PAGE PACKAGE...` draws so many faults by seed, runs the tests of each one's package
with it, and writes what survived into the page. A fault is one changed comparison, connective, negation, sign or number
of the syntax tree; the file on the disk stays as it is, the changed tree is compiled in the process that tests it.
A mutant is *killed* where a test fails, or does not end in time; one that no test can see is *equivalent*, and a person
must say why: `EQUIVALENT` below.
"""

from __future__ import annotations

import ast
import os
import random
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PATIENCE_S = 900
SECTION = "\n## Mutants"
TESTS: dict[str, tuple[str, ...]] = {
    "gateway/interlocks": ("tests/unit/interlocks",),
    "gateway/audit": ("tests/unit/audit", "tests/unit/approve/test_attacks.py"),
    "gateway/push": ("tests/unit/push", "tests/unit/approve/test_attacks.py"),
}
EQUIVALENT: dict[str, str] = {}
"""Mutants that no test can see, by file, line and change, with the reason."""

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
_COUNTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One fault: the file, which of its places, the line there and what is changed."""

    path: str
    number: int
    line: int
    change: str

    @property
    def name(self) -> str:
        """As people name it."""
        return f"{self.path}:{self.line} {self.change}"


class _Changing(ast.NodeTransformer):
    """Counts the places of a tree and changes the one with this number (-1: none)."""

    def __init__(self, number: int = -1) -> None:
        self.number, self.seen = number, list[tuple[int, str]]()

    def _is_it(self, node: Any, change: str) -> bool:
        self.seen.append((node.lineno, change))
        return len(self.seen) - 1 == self.number

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        other = _COMPARED[type(node.ops[0])]
        if self._is_it(node, f"{type(node.ops[0]).__name__} to {other.__name__}"):
            node.ops[0] = other()
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        if self._is_it(node, f"{type(node.op).__name__} to {other.__name__}"):
            node.op = other()
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Not | ast.USub) and self._is_it(node, f"without {type(node.op).__name__}"):
            return node.operand
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        other = _COUNTED.get(type(node.op))
        if other is not None and self._is_it(node, f"{type(node.op).__name__} to {other.__name__}"):
            node.op = other()
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if type(node.value) in (int, float) and self._is_it(node, f"{node.value} to {node.value + 1}"):
            return ast.copy_location(ast.Constant(node.value + 1), node)
        if isinstance(node.value, bool) and self._is_it(node, f"{node.value} to {not node.value}"):
            return ast.copy_location(ast.Constant(not node.value), node)
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        if self._is_it(node, "if never"):
            node.test = ast.copy_location(ast.Constant(value=False), node.test)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_arg(self, node: ast.arg) -> ast.AST:
        return node


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Every fault that a file can be given."""
    seen = _Changing()
    seen.visit(ast.parse(path.read_text(encoding="utf-8")))
    for number, (line, change) in enumerate(seen.seen):
        yield Mutant(path.relative_to(ROOT).as_posix(), number, line, change)


def changed(source: str, number: int, name: str) -> CodeType:
    """A file's code with the fault of this number."""
    tree = _Changing(number).visit(ast.parse(source))
    return compile(ast.fix_missing_locations(tree), name, "exec", dont_inherit=True)


def run_with(path: Path, number: int, arguments: Sequence[str]) -> int:
    """Run tests in this process with one fault; pytest's exit code."""
    usual = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, fullname: str) -> CodeType | None:
        if Path(self.path).resolve() != path.resolve():
            return usual(self, fullname)
        return changed(path.read_text(encoding="utf-8"), number, str(path))

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    return int(pytest.main(["-x", "-q", "-n", "0", "-p", "no:cacheprovider", *arguments]))


def outcome_of(mutant: Mutant | None, tests: Sequence[str]) -> bool:
    """Whether the tests find a fault (None: whether they fail without one); too slow is found."""
    what = (mutant.path, str(mutant.number)) if mutant else ("tests/mutants.py", "-1")
    command = [sys.executable, "-m", "tests.mutants", "--with", *what, *tests]
    command += ["-m", "not long and not soak and not services and not interop and not browser and not release"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def page_of(found: dict[str, list[tuple[Mutant, bool]]], seed: int) -> str:
    """The section of the page."""
    lines = [
        SECTION.strip(),
        "",
        f"Small faults put into the code by seed {seed}, one at a time, each tried by the quick tests of its package."
        " Repeat with `make mutants`.",
        "",
        "| package | faults drawn | found by a test | share |",
        "|---|---:|---:|---:|",
    ]
    for package, all_of in found.items():
        killed = sum(one for _mutant, one in all_of)
        share = f"{100.0 * killed / len(all_of):.0f} %" if all_of else "-"
        lines.append(f"| `{package}` | {len(all_of)} | {killed} | {share} |")
    left = [mutant for all_of in found.values() for mutant, killed in all_of if not killed]
    lines += ["", "Not found:" if left else "None survived.", ""]
    lines += [f"- `{one.name}`: {EQUIVALENT.get(one.name, 'no test sees it')}" for one in left]
    return "\n".join(lines).rstrip() + "\n"


def main(seed: int, count: int, page: Path, packages: Sequence[str]) -> int:
    """Draw, run and write; 1 where tests fail without a fault."""
    found: dict[str, list[tuple[Mutant, bool]]] = {}
    for package in packages:
        if outcome_of(None, TESTS[package]):
            print(f"{package}: its tests fail without a fault")
            return 1
        files = sorted(path for path in (ROOT / package).glob("*.py") if path.name != "__init__.py")
        every = [mutant for path in files for mutant in mutants_of(path)]
        drawn = random.Random(f"{seed} {package}").sample(every, min(count, len(every)))
        found[package] = []
        for mutant in drawn:
            found[package].append((mutant, outcome_of(mutant, TESTS[package])))
            print(f"{'found' if found[package][-1][1] else 'SURVIVED'}: {mutant.name}", flush=True)
    text = page.read_text(encoding="utf-8")
    head, _, rest = text.partition(SECTION)
    after = rest[rest.index("\n## ") :] if "\n## " in rest else ""
    page.write_text(f"{head.rstrip()}\n\n{page_of(found, seed)}{after}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = True
    if sys.argv[1] == "--with":
        sys.exit(run_with(ROOT / sys.argv[2], int(sys.argv[3]), sys.argv[4:]))
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:] or list(TESTS)))
