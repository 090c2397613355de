"""What `install.cmd` does, as far as another system can judge: its check of the sums runs here, its order is read.

It never ran on Windows here.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "release" / "install.cmd").read_text(encoding="ascii")
LINES = [line.strip() for line in TEXT.splitlines() if not line.startswith("rem ")]


def _place(start: str) -> int:
    (found,) = (number for number, line in enumerate(LINES) if line.startswith(start))
    return found


@pytest.mark.parametrize(
    ("file", "data", "code"),
    [("", b"", 0), ("wheels/a.whl", b"other", 1), ("wheels/a.whl", None, 1), ("SHA256SUMS", b"", 1)],
)
def test_a_bundle_that_is_not_as_it_was_made_is_told(tmp_path: Path, file: str, data: bytes | None, code: int) -> None:
    (tmp_path / "wheels").mkdir()
    files = {"VERSION": b"1\n", "wheels/a.whl": b"wheel"}
    for name, inside in files.items():
        (tmp_path / name).write_bytes(inside)
    sums = "".join(f"{hashlib.sha256(inside).hexdigest()}  {name}\n" for name, inside in files.items())
    (tmp_path / "SHA256SUMS").write_bytes(sums.encode())
    if file and data is None:
        (tmp_path / file).unlink()
    elif data is not None and file:
        (tmp_path / file).write_bytes(data)
    (check,) = (one for one in re.findall(r'py -3\.11 -c "([^"]+)"', TEXT) if "SHA256SUMS" in one)
    assert "%" not in check
    done = subprocess.run([sys.executable, "-c", check, f"{tmp_path}/."], capture_output=True, check=False, text=True)
    assert done.returncode == code, done.stderr


def test_the_version_of_before_stays_until_the_new_one_is_whole() -> None:
    sums, kept = _place('py -3.11 -c "import hashlib'), _place('fc /b "%here%requirements.lock"')
    made, filled = _place('py -3.11 -m venv "%new%.new"'), _place('"%new%.new\\Scripts\\python" -m pip install')
    whole, aside = _place('copy /y "%here%requirements.lock" "%new%.new'), _place('move "%new%" "%new%.old"')
    placed, started = _place('move "%new%.new" "%new%"'), _place("move /y")
    assert sums < kept < made < filled < whole < aside < placed < started
    removed = re.findall(r'rmdir /s /q "([^"]+)"', TEXT)
    assert set(removed) == {"%new%.new", "%new%.old"}
    assert not re.search(r"(?m)^\s*(goto|:\w)", TEXT)


def test_no_name_of_a_folder_stands_bare_inside_the_block() -> None:
    """A folder such as `Program Files (x86)` would end it."""
    block = TEXT[TEXT.index("if not defined whole (") : TEXT.index("\n)\n>")]
    assert not [line for line in block.splitlines() if "%" in re.sub(r'"[^"]*"', "", line)]
