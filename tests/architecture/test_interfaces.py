"""Packages with a public interface: who is outside imports from the package itself, never from a module inside it.

`PUBLIC` names the packages that are closed today. What a package exports is in its `__init__`; a module that is named
here is part of the interface too, because loading it costs what most callers do not need.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.sources import nodes

ROOT = Path(__file__).parents[2]
OUTSIDE = ("gateway", "drivers", "trueflank", "release")
PUBLIC: dict[str, frozenset[str]] = {
    "drivers.clock": frozenset(),
    "drivers.transport": frozenset(),
    "gateway.audit": frozenset(),
    "gateway.broker": frozenset(),
    "gateway.config": frozenset(),
    "gateway.daemon": frozenset(),
    "gateway.guard": frozenset(),
    "gateway.index": frozenset(),
    "gateway.interlocks": frozenset(),
    "gateway.mqtt": frozenset(("connecting",)),
    "gateway.push": frozenset(),
    "gateway.store": frozenset(("log_book", "machine_books", "raw_stream")),
    "gateway.users": frozenset(),
    "gateway.watch": frozenset(),
}


def entered(path: Path, package: str, public: frozenset[str]) -> Iterator[str]:
    """Imports of modules inside a package, where they are no part of its interface."""
    inside = {one.stem for one in (ROOT / package.replace(".", "/")).glob("*.py")} - {"__init__"}
    for node in nodes(path, ast.Import, ast.ImportFrom):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        else:
            taken = [f"{node.module}.{alias.name}" for alias in node.names if node.module == package]
            found = [one for one in taken if one.rpartition(".")[2] in inside] or [node.module or ""]
        for name in found:
            if name.startswith(f"{package}.") and name.removeprefix(f"{package}.").split(".")[0] not in public:
                yield f"{path.relative_to(ROOT)}:{node.lineno}: {name}"


@pytest.mark.parametrize("package", sorted(PUBLIC))
def test_who_is_outside_imports_from_the_package(package: str) -> None:
    own = ROOT / package.replace(".", "/")
    paths = (path for top in OUTSIDE for path in sorted((ROOT / top).rglob("*.py")) if own not in path.parents)
    assert [one for path in paths for one in entered(path, package, PUBLIC[package])] == []


@pytest.mark.parametrize("package", sorted(PUBLIC))
def test_a_public_module_is_there(package: str) -> None:
    """A name that nothing has any more would allow what it does not mean."""
    assert [name for name in PUBLIC[package] if not (ROOT / package.replace(".", "/") / f"{name}.py").exists()] == []


def test_an_entered_package_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test fails on a violation: a module, and a module taken from its package; not what is exported."""
    (tmp_path / "gateway" / "store").mkdir(parents=True)
    (tmp_path / "gateway" / "store" / "disk.py").touch()
    (tmp_path / "gateway" / "store" / "raw_stream.py").touch()
    user = tmp_path / "gateway" / "user.py"
    user.write_text(
        "from gateway.store import Store\nfrom gateway.store.disk import replace\nfrom gateway.store import disk\n"
        "import gateway.store.disk\nfrom gateway.store.raw_stream import RawRecorder\n",
        encoding="utf-8",
    )
    monkeypatch.setattr("tests.architecture.test_interfaces.ROOT", tmp_path)
    found = [one.partition(": ") for one in sorted(entered(user, "gateway.store", frozenset({"raw_stream"})))]
    assert [(place, name) for place, _, name in found] == [
        (f"gateway/user.py:{line}", "gateway.store.disk") for line in (2, 3, 4)
    ]
