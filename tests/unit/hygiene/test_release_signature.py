"""The signature of a release's sums: right for this key and these bytes alone, and checked by a stranger's program."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from release.signing import is_signed, main, make, sign


@pytest.fixture
def key(tmp_path: Path) -> Path:
    made = tmp_path / "release.pem"
    make(made)
    return made


@pytest.fixture
def sums(tmp_path: Path) -> Path:
    place = tmp_path / "SHA256SUMS"
    place.write_text(f"{'a' * 64}  trueflank.whl\n")
    return place


def test_signed_sums_are_those_of_this_key_and_nothing_else(key: Path, sums: Path, tmp_path: Path) -> None:
    public, other = key.with_name("release.pem.pub"), tmp_path / "other.pem"
    make(other)
    assert main(["check", str(public), str(sums)]) == 1
    assert main(["sign", str(key), str(sums)]) == 0
    assert main(["check", str(public), str(sums)]) == 0
    assert not is_signed(other.with_name("other.pem.pub"), sums)
    sums.write_text(sums.read_text().replace("a", "b", 1))
    assert not is_signed(public, sums)
    assert key.stat().st_mode & 0o077 == 0
    with pytest.raises(FileExistsError):
        make(key)


def test_openssl_says_the_same(key: Path, sums: Path) -> None:
    program = shutil.which("openssl")
    if program is None:
        pytest.skip("no openssl here")
    signature = sign(key, sums)
    command = [program, "pkeyutl", "-verify", "-pubin", "-inkey", f"{key}.pub", "-rawin", "-in", str(sums)]
    command += ["-sigfile", str(signature)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    sums.write_text("changed\n")
    assert subprocess.run(command, capture_output=True, check=False).returncode != 0
