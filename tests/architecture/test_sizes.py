"""Files and folders stay readable, no import goes in a circle, and each foreign library is bound to its packages."""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

from tests.architecture.sources import nodes

ROOT = Path(__file__).parents[2]
TOPS = ("gateway", "drivers", "simulators", "trueflank")
LARGEST_FOLDER, LONGEST_FILE = 25, 600
LOADED_BY_NAME = {"drivers/registry.py", "gateway/cli/command_list.py"}
STILL_BY_NAME: set[str] = set()
"""Files that load modules by a text and will not: this list only shrinks."""
LIBRARIES = {
    "aiomqtt": {"gateway.mqtt"},
    "alembic": {"gateway.index"},
    "argon2": {"gateway.users"},
    "asyncua": {"drivers.sinumerik", "simulators.opcua"},
    "cryptography": {"drivers.sinumerik", "gateway.users"},
    "distributed": {"gateway.study"},
    "ezdxf": {"gateway.study"},
    "fastapi": {"gateway.web"},
    "hal": {"drivers.linuxcnc"},
    "jinja2": {"gateway.report", "gateway.web"},
    "lark": {"simulators.nck"},
    "linuxcnc": {"drivers.linuxcnc"},
    "markupsafe": {"gateway.report"},
    "matplotlib": {"gateway.report", "gateway.study", "gateway.workflow"},
    "mpl_toolkits": {"gateway.study"},
    "openpyxl": {"drivers.files"},
    "pandas": {"trueflank"},
    "prometheus_client": {"gateway.web"},
    "pydantic": {
        "drivers",
        "drivers.attocube",
        "drivers.bridge",
        "drivers.gauge",
        "drivers.linuxcnc",
        "drivers.manual",
        "drivers.sinumerik",
        "drivers.umd",
        "gateway",
        "gateway.config",
        "gateway.study",
        "gateway.web",
        "simulators.cellfile",
        "simulators.reducer",
    },
    "pymodbus": {"drivers.sinumerik"},
    "pytest": {"gateway.acceptance", "simulators"},
    "rich": {"gateway.cli"},
    "scipy": {
        "gateway.correct",
        "gateway.daemon",
        "gateway.evaluate",
        "gateway.gear",
        "gateway.guard",
        "gateway.model",
        "gateway.process",
        "gateway.reducer",
        "gateway.sensitivity",
        "gateway.table",
        "simulators.grinding",
        "simulators.reducer",
    },
    "serial": {"drivers"},
    "sqlalchemy": {"gateway.index"},
    "starlette": {"gateway.web"},
    "typer": {"gateway.cli"},
    "typst": {"gateway.report"},
    "uvicorn": {"gateway.daemon"},
}
"""The packages that may import each foreign library; numpy is the language of the maths and may be anywhere."""
ANYWHERE = {"numpy"}


@cache
def _paths() -> list[Path]:
    return [path.relative_to(ROOT) for top in TOPS for path in sorted((ROOT / top).rglob("*.py"))]


def test_files_are_short() -> None:
    lines = {str(path): len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in _paths()}
    assert {path: count for path, count in lines.items() if count > LONGEST_FILE} == {}


def test_folders_are_small() -> None:
    folders = Counter(str(path.parent) for path in _paths() if path.name != "__init__.py")
    assert {folder: count for folder, count in folders.items() if count > LARGEST_FOLDER} == {}


def _module(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def _imported(path: Path) -> list[tuple[str, str]]:
    """(module, name) of every import statement, those inside functions too; the name is empty in `import module`."""
    found = [(alias.name, "") for node in nodes(ROOT / path, ast.Import) for alias in node.names]
    return found + [
        (node.module or "", alias.name) for node in nodes(ROOT / path, ast.ImportFrom) for alias in node.names
    ]


@cache
def _graph() -> dict[str, set[str]]:
    """What each module imports of ours; a module that is taken from its package counts, not the package."""
    modules = {_module(path): path for path in _paths()}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        found = {f"{one}.{two}" if f"{one}.{two}" in modules else one for one, two in _imported(path)}
        graph[name] = {other for other in found if other in modules} - {name}
    return graph


def _circle(graph: dict[str, set[str]]) -> list[str]:
    """A way from a module back to itself, empty where there is none."""
    done: set[str] = set()

    def walk(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        for other in sorted(graph[name] if name not in done else ()):
            if found := walk(other, [*way, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


def test_no_import_goes_in_a_circle() -> None:
    assert _circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert _circle(_graph()) == []


def test_modules_are_loaded_by_name_in_the_registry_alone() -> None:
    kinds = (ast.ImportFrom, ast.Attribute, ast.Name)
    loading = {str(path) for path in _paths() if any(_loads(node) for node in nodes(ROOT / path, *kinds))}
    assert loading - STILL_BY_NAME == LOADED_BY_NAME
    assert STILL_BY_NAME - loading == set(), "cured: take them off the list"


def _loads(node: ast.AST) -> bool:
    if isinstance(node, ast.ImportFrom):
        return node.module == "importlib" and any(alias.name == "import_module" for alias in node.names)
    return (isinstance(node, ast.Attribute) and node.attr == "import_module") or (
        isinstance(node, ast.Name) and node.id == "__import__"
    )


def _package(path: Path) -> str:
    """The package that a file belongs to: `gateway.web`, `drivers.sinumerik`, or `gateway` for a loose module."""
    return ".".join(path.parts[: 2 if len(path.parts) > 2 else 1])


def test_foreign_libraries_are_imported_by_their_packages_alone() -> None:
    places: dict[str, set[str]] = defaultdict(set)
    for path in _paths():
        for module, _name in _imported(path):
            places[module.partition(".")[0]].add(_package(path))
    foreign = set(places) - set(sys.stdlib_module_names) - set(TOPS) - ANYWHERE
    assert {library: places[library] for library in sorted(foreign)} == LIBRARIES
