"""Figures of the source: `python -m benchmarks.structure` counts files, imports, names and what one push executes.

They compare the source before and after a restructuring; none of them is a goal by itself. A name counts as opaque
when it is a single participle, adverb or preposition ("told", "whole", "beside"): it says neither what a function does
nor what a value is. The push is that of the benchmark: one table over OPC UA into the simulated control.
"""

from __future__ import annotations

import ast
import io
import re
import statistics
import sys
import threading
import tokenize
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from benchmarks import push
from drivers.clock import run_virtual

ROOT = Path(__file__).absolute().parents[1]
PACKAGES = ("gateway", "drivers", "simulators", "trueflank")
PARTICIPLE = re.compile(r"_?[a-z]+(?:ed|ing|en|own|old|aid|ound|ept|eft|elt|ught)$")
NO_PARTICIPLES = frozenset(
    (
        "bed",
        "feed",
        "speed",
        "need",
        "seed",
        "ring",
        "string",
        "thing",
        "bound",
        "round",
        "sound",
        "heading",
        "reading",
        "setting",
        "spacing",
        "bearing",
        "token",
        "open",
        "screen",
        "hidden",
        "median",
        "threshold",
        "hold",
        "fold",
        "index",
        "ping",
        "timing",
        "mapping",
        "encoding",
        "rounding",
        "mounting",
        "grinding",
        "ground",
    )
)
ADVERBS = frozenset(
    ("whole", "beside", "alike", "aside", "apart", "anew", "away", "onward", "beforehand", "without", "within")
)


@dataclass(frozen=True, slots=True)
class Module:
    """One source file: its syntax tree, lines, lines of imports and lines of comments."""

    path: Path
    tree: ast.Module
    lines: int
    import_lines: int
    comment_lines: int


def modules(packages: tuple[str, ...] = PACKAGES) -> list[Module]:
    """Every module of the product, in the order of the paths."""
    return [_module(path) for name in packages for path in sorted((ROOT / name).rglob("*.py"))]


def _module(path: Path) -> Module:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    comments = sum(one.type == tokenize.COMMENT for one in tokenize.generate_tokens(io.StringIO(text).readline))
    spans = sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)
    return Module(path, tree, text.count("\n"), spans, comments)


def own_imports(module: Module) -> int:
    """How many modules of the product a module imports."""
    named = {
        node.module
        for node in ast.walk(module.tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES
    }
    return len(named)


def is_opaque(name: str) -> bool:
    """Whether a name is one bare participle, adverb or preposition."""
    word = name.strip("_").lower()
    return word in ADVERBS or (bool(PARTICIPLE.fullmatch(word)) and word not in NO_PARTICIPLES)


def opaque_names(module: Module) -> Iterator[str]:
    """The module's own name, and its functions and classes, as far as they are opaque."""
    defined = [
        node.name
        for node in ast.walk(module.tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
    ]
    yield from (name for name in [module.path.stem, *defined] if is_opaque(name))


def executed(call: Callable[[], None]) -> tuple[set[str], set[tuple[str, str, int]]]:
    """Files and functions of gateway and drivers that a call executes."""
    functions: set[tuple[str, str, int]] = set()
    roots = tuple(str(ROOT / name) for name in ("gateway", "drivers"))

    def profile(frame: FrameType, event: str, _arg: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(roots) and code.co_name != "<module>":
            functions.add((code.co_filename, code.co_name, code.co_firstlineno))

    threading.setprofile(profile)
    sys.setprofile(profile)
    try:
        call()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return {file for file, _, _ in functions}, functions


def figures(found: list[Module]) -> list[tuple[str, str]]:
    """Each figure with its name."""
    lines = sum(one.lines for one in found)
    imports = sorted(own_imports(one) for one in found)
    opaque = [name for one in found for name in opaque_names(one)]
    bodies = [
        node for one in found for node in ast.walk(one.tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    short = sum(len(node.body) - isinstance(node.body[0], ast.Expr) <= 1 for node in bodies)
    return [
        ("files", str(len(found))),
        ("folders", str(len({one.path.parent for one in found}))),
        ("lines", str(lines)),
        ("lines of imports", str(sum(one.import_lines for one in found))),
        ("own modules imported by a file, median", f"{statistics.median(imports):.0f}"),
        ("own modules imported by a file, 90 %", str(imports[int(0.9 * len(imports))])),
        ("functions", str(len(bodies))),
        ("functions with one statement", str(short)),
        ("opaque names", str(len(opaque))),
        ("comment lines per 100", f"{100 * sum(one.comment_lines for one in found) / lines:.1f}"),
    ]


def push_one_table() -> None:
    """The benchmark's push with the control in this process, in virtual time."""
    outcome = run_virtual(push.together)
    if outcome != "committed":
        raise SystemExit(f"the push ended {outcome}")


def main() -> None:
    """Print the figures of the product."""
    for name, value in figures(modules()):
        sys.stdout.write(f"{name:42} {value:>8}\n")
    files, functions = executed(push_one_table)
    sys.stdout.write(f"{'files that one push executes':42} {len(files):>8}\n")
    sys.stdout.write(f"{'functions that one push executes':42} {len(functions):>8}\n")


if __name__ == "__main__":
    main()
