"""A clean environment in a folder outside the source, and the start of the demo from there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BIN = "Scripts" if sys.platform == "win32" else "bin"
# What a person sees when cell, control, instruments and self-test work.
STARTED = "X1: self-test passed"


def clean() -> dict[str, str]:
    """This process's environment without what would lead back to the source."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}


def run(*words: str | Path, cwd: Path, expect: int = 0, seconds: float = 280) -> str:
    """Run a command; its output, both streams. A different exit code is an error that shows them."""
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=clean(), capture_output=True, text=True, check=False, timeout=seconds)
    told = done.stdout + done.stderr
    assert done.returncode == expect, f"{command} ended with {done.returncode}:\n{told}"
    return told


def venv(folder: Path) -> Path:
    """A fresh environment; the folder of its programs."""
    run(sys.executable, "-m", "venv", folder, cwd=folder.parent)
    return folder / BIN


def built(folder: Path, source: Path = ROOT) -> tuple[Path, Path]:
    """The wheel and the source archive of a source, without an index."""
    run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=source)
    (wheel,), (archive,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, archive


def demo_starts(programs: Path, folder: Path, before: tuple[str, ...] = ()) -> None:
    """Start `trueflank demo` in a folder, wait until the control has tried our programs, and end it."""
    command = [*before, str(programs / "trueflank"), "demo", "-v", "--folder", str(folder / "demo")]
    told = subprocess.STDOUT  # progress is for people: it goes to the other stream
    seen = []
    with subprocess.Popen(command, cwd=folder, env=clean(), stdout=subprocess.PIPE, stderr=told, text=True) as child:
        for line in child.stdout or ():
            seen.append(line.rstrip())
            if STARTED in line:
                break
        child.terminate()
        seen += [line.rstrip() for line in child.stdout or ()]
    assert any(STARTED in line for line in seen), seen
    assert (folder / "demo" / "site.toml").is_file()
