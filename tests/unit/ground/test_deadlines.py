"""A deadline under every order of timer, answer and cancel in one turn of the loop, on each Python that is here."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.ground import deadlines

ROOT = Path(__file__).parents[3]
VERSIONS = ("3.11", "3.12", "3.13")
HERE = f"{sys.version_info[0]}.{sys.version_info[1]}"


def test_whatever_a_library_makes_of_the_cancel() -> None:
    assert deadlines.play() == 248


@pytest.mark.parametrize("version", [version for version in VERSIONS if version != HERE])
def test_the_same_on_another_python(version: str) -> None:
    found = interpreter(version)
    if found is None:
        pytest.skip(f"not run: no Python {version} here")
    done = subprocess.run(
        [found, "-I", "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); {_PLAY}"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["248", version]


_PLAY = "from tests.unit.ground import deadlines; print(deadlines.play(), '%d.%d' % sys.version_info[:2])"


def interpreter(version: str) -> str | None:
    """A Python of that version on the path, or among those that pyenv keeps; None where there is none that starts."""
    named = shutil.which(f"python{version}")
    kept = sorted(_kept().glob(f"{version}.*/bin/python{version}"))
    return next((path for path in (named, *map(str, kept)) if path and _is(path, version)), None)


def _kept() -> Path:
    """Where pyenv keeps its interpreters; a name on the path that it does not have set does not start."""
    pyenv = shutil.which("pyenv")
    if pyenv is None:
        return Path("/nonexistent")
    done = subprocess.run([pyenv, "root"], capture_output=True, text=True, timeout=60, check=False)
    return Path(done.stdout.strip()) / "versions"


def _is(path: str, version: str) -> bool:
    done = subprocess.run(
        [path, "-I", "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return done.stdout.strip() == version
