"""Wheel and source archive: they hold what they must, and work in a clean environment outside the source."""

from __future__ import annotations

import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.release.placing import ROOT, built, demo_starts, run, venv

pytestmark = [pytest.mark.release, pytest.mark.timeout(900)]
TOPS = ("drivers", "gateway", "simulators", "trueflank")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return built(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def programs(made: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment as on a shop-floor PC: the lock by its hashes, then the wheel and nothing else."""
    folder = tmp_path_factory.mktemp("clean")
    here = venv(folder / "env")
    run(here / "python", "-m", "pip", "install", "-q", "--require-hashes", "-r", ROOT / "requirements.lock", cwd=folder)
    run(here / "python", "-m", "pip", "install", "-q", "--no-deps", "--no-index", made[0], cwd=folder)
    return here


def _source_files() -> set[str]:
    """What the four packages consist of on the disk."""
    found = (path for top in TOPS for path in (ROOT / top).rglob("*") if path.is_file() and path.suffix != ".pyc")
    return {path.relative_to(ROOT).as_posix() for path in found}


def test_the_wheel_holds_the_four_packages_whole_and_nothing_else(made: tuple[Path, Path]) -> None:
    names = set(zipfile.ZipFile(made[0]).namelist())
    inside = {name for name in names if ".dist-info/" not in name}
    assert inside == _source_files()
    assert {name.split("/")[0] for name in inside} == set(TOPS)
    assert "trueflank/py.typed" in inside


def test_the_source_archive_builds_the_same_wheel(made: tuple[Path, Path], tmp_path: Path) -> None:
    with tarfile.open(made[1]) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    for name in (
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "requirements.lock",
        "tests/conftest.py",
        "Makefile",
    ):
        assert (source / name).is_file(), name
    again, _ = built(tmp_path / "again", source)
    first, second = zipfile.ZipFile(made[0]), zipfile.ZipFile(again)
    assert {one.filename: one.CRC for one in first.infolist()} == {one.filename: one.CRC for one in second.infolist()}


def test_the_demo_starts_from_an_environment_outside_the_source(programs: Path, tmp_path: Path) -> None:
    assert "trueflank 0.1.0" in run(programs / "trueflank", "--version", cwd=tmp_path)
    where = run(programs / "python", "-c", "import gateway, simulators; print(gateway.__file__)", cwd=tmp_path)
    assert str(ROOT) not in where
    demo_starts(programs, tmp_path)


def test_without_the_simulators_extra_every_command_that_needs_it_names_it(programs: Path, tmp_path: Path) -> None:
    """Last in this file: it takes the extra away."""
    run(programs / "python", "-m", "pip", "uninstall", "-q", "-y", "lark", "typst", cwd=tmp_path)
    for words in (["demo"], ["simulate", "demo"], ["simulate", "--list"]):
        told = run(programs / "trueflank", *words, cwd=tmp_path, expect=2)
        assert "trueflank[sim]" in " ".join(told.split()), told
        assert "Traceback" not in told
    for words in (["--help"], ["docs", "commands"], ["explain", "E-EXTRA-MISSING"], ["simulate", "--help"]):
        run(programs / "trueflank", *words, cwd=tmp_path)
    copy = tmp_path / "X.rtl"
    copy.write_bytes((ROOT / "tests" / "golden" / "files" / "basic.rtl").read_bytes())
    assert "B" in run(programs / "trueflank", "evaluate", copy, cwd=tmp_path)
