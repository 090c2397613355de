"""Every room says what it is for, every public name is documented, and nothing unfinished stands in the source."""

from __future__ import annotations

import ast
import itertools
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from release.vendored import libraries
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


LOCKED = re.compile(r"([a-z0-9.\-]+(?:\[[a-z]+\])?)==([^\s;]+)(?: ; [^\\]+)?(?: \\)?")
HASH = re.compile(r"    --hash=sha256:[0-9a-f]{64}(?: \\)?")


def _locked(path: Path) -> dict[str, str]:
    """Name -> version of a lock; every line is a pin or a hash, and every pin has hashes: no address, no local path."""
    blocks = re.split(r"\n(?=\S)", path.read_text(encoding="utf-8").strip())
    found = {}
    for block in blocks:
        first, *hashes = block.split("\n")
        pin = LOCKED.fullmatch(first)
        assert pin, f"{path.name}: {first}"
        assert hashes, f"{path.name}: {first} has no hash"
        assert all(HASH.fullmatch(line) for line in hashes), f"{path.name}: {first}"
        found[pin.group(1).split("[")[0]] = pin.group(2)
    return found


def _named(asked: list[str]) -> set[str]:
    return {re.split(r"[<>=\[ ]", one)[0].lower().replace("_", "-") for one in asked}


def test_every_package_is_pinned_with_hashes_and_every_lock_has_the_same_versions() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    needed, extras = project["project"]["dependencies"], project["project"]["optional-dependencies"]
    groups = project["dependency-groups"]
    wanted = {
        "requirements.lock": [*needed, *extras["sim"], *extras["report"]],
        "locks/dev.lock": [
            *needed,
            *extras["sim"],
            *extras["report"],
            *extras["cluster"],
            *extras["dev"],
            *groups["build"],
        ],
        "locks/peers.lock": [*needed, *itertools.chain.from_iterable(extras.values()), *groups["build"]],
        "locks/build.lock": groups["build"],
        "locks/tools.lock": groups["tools"],
    }
    versions: dict[str, str] = {}
    for name, asked in wanted.items():
        locked = _locked(ROOT / name)
        assert _named(asked) <= set(locked), f"{name}: make lock"
        others = {one: version for one, version in locked.items() if versions.setdefault(one, version) != version}
        assert others == {}, f"{name}: make lock"


def test_the_page_of_licences_has_every_package_of_the_shop_floor() -> None:
    rows = re.findall(
        r"^\| ([\w.-]+) \| ([\w.]+) \| (.+) \|$", (ROOT / "docs" / "licences.md").read_text(), re.MULTILINE
    )
    told = {re.sub(r"[._-]+", "-", name).lower(): version for name, version, _ in rows if name != "package"}
    page = {one["name"]: one["version"] for one in libraries()}
    assert told | {"colorama": ""} == _locked(ROOT / "requirements.lock") | page | {"colorama": ""}, "make sbom"


def test_help_does_not_load_what_it_does_not_need() -> None:
    code = "import gateway.cli, sys; print([m for m in ('numpy','scipy','asyncua','matplotlib') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_a_service_begins_without_what_only_work_needs() -> None:
    """A start that loads scipy and the like takes twice its time: `import scipy` alone loads no part of it."""
    numbers = ("scipy.sparse", "scipy.special", "scipy.optimize", "scipy.interpolate", "scipy.signal")
    late = (*numbers, "typst", "matplotlib", "sqlalchemy", "alembic", "aiomqtt", "asyncua")
    code = f"import gateway.daemon, sys; print([m for m in {late} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
