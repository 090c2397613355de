"""The bundle of this system, installed and started with the network cut; other versions leave people's work alone."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from release.bundle import EXTRAS, PLATFORMS, pins
from tests.release.placing import ROOT, demo_starts, run

OWN_LOOPBACK = """
import fcntl, os, socket, struct, sys
sock = socket.socket()
fcntl.ioctl(sock, 0x8914, struct.pack("16sH14x", b"lo", 0x41))  # SIOCSIFFLAGS: up and running
try:
    socket.create_connection(("192.0.2.1", 80), 2)
    sys.exit("the network is not cut")
except OSError as error:
    assert error.errno == 101, error  # network is unreachable
os.execvp(sys.argv[1], sys.argv[1:])
"""
CUT = ("unshare", "-rn", sys.executable, "-c", OWN_LOOPBACK)
pytestmark = [
    pytest.mark.release,
    pytest.mark.timeout(900),
    pytest.mark.skipif(sys.platform != "linux", reason="unshare is Linux'"),
]
NEWER = "0.1.1"
CONSENT = """
import asyncio, sys
from drivers.clock import LoopClock
from gateway import audit
from gateway.approve import Approvals
from gateway.domain.proposals import Approval
from gateway.store import Store
from gateway.store.records import encode, sha256

async def main():
    folder = Store(sys.argv[1]).open("latest")
    approvals = Approvals(folder.path)
    for actor in sys.argv[2:]:
        days = ("2026-03-02T08:00:00+00:00", "2026-03-02T08:10:00+00:00")
        given = Approval(actor, "a" * 64, "b" * 64, "7", *days, folder.run_id)
        said = {"run": folder.run_id, "approval": sha256(encode(given))}
        audit.record(folder.path.parent, "approve", clock=LoopClock(), actor=actor, role="approver", serial="7",
                     plan_hash=given.plan_hash, base_hash=given.base_digest, details=said)
        approvals.keep(given)
    print("approved by:", *(one.actor for one in approvals.read_unused()))

asyncio.run(main())
"""


def _bundle(ending: str) -> Path:
    (found,) = (ROOT / "dist").glob(f"trueflank-*{ending}")
    return found


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stick")
    with tarfile.open(_bundle(".tar.gz")) as archive:
        archive.extractall(place, filter="data")
    (folder,) = place.iterdir()
    return folder


def _newer(folder: Path, place: Path) -> Path:
    """The same bundle as a later version would be: its wheel, lock, sums and version changed, nothing else."""
    later = place / "later"
    shutil.copytree(folder, later)
    version = (folder / "VERSION").read_text().strip()
    (old,) = (later / "wheels").glob("trueflank-*.whl")
    new = old.with_name(old.name.replace(version, NEWER))
    with zipfile.ZipFile(old) as source, zipfile.ZipFile(new, "w") as target:
        for one in source.infolist():
            text = source.read(one)
            if ".dist-info/" in one.filename:
                text = text.replace(f"Version: {version}".encode(), f"Version: {NEWER}".encode())
            if one.filename.endswith("/RECORD"):
                text = b"\n".join(b",".join([*line.split(b",")[:1], b"", b""]) for line in text.splitlines())
                text = text.replace(f"trueflank-{version}".encode(), f"trueflank-{NEWER}".encode())
            target.writestr(one.filename.replace(f"trueflank-{version}", f"trueflank-{NEWER}"), text)
    old.unlink()
    lock = later / "requirements.lock"
    others = [line for line in lock.read_text().splitlines() if not line.startswith("trueflank")]
    mine = f"trueflank[{EXTRAS}]=={NEWER} --hash=sha256:{hashlib.sha256(new.read_bytes()).hexdigest()}"
    lock.write_text("\n".join([*others, mine]) + "\n")
    (later / "VERSION").write_text(NEWER + "\n")
    _sum_up(later)
    return later


def _sum_up(folder: Path) -> None:
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "SHA256SUMS")
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder)}" for path in files]
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n")


def _contents(folder: Path) -> dict[str, str]:
    """Every file but the logs, which a command goes on with."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.parent.name != "logs")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _consents(home: Path, version: str, cwd: Path, *words: str | Path) -> str:
    """Who approved the latest run, as an installed version reads it, after those that are named have."""
    return run(home / "versions" / version / "bin" / "python", "-c", CONSENT, *words, cwd=cwd)


def test_it_installs_and_starts_without_a_network_and_other_versions_keep_what_people_made(
    unpacked: Path, tmp_path: Path
) -> None:
    home = tmp_path / "trueflank"
    assert "is installed" in run(*CUT, "sh", unpacked / "install.sh", home, cwd=tmp_path, seconds=600)
    demo_starts(home, tmp_path, before=CUT)
    people = tmp_path / "demo"
    runs = people / "runs"
    run(home / "trueflank", "import", ROOT / "tests" / "golden" / "files" / "basic.rtl", "--store", runs, cwd=tmp_path)
    assert "approved by: ada bob" in _consents(home, "0.1.0", tmp_path, runs, "ada", "bob")
    shown = run(home / "trueflank", "runs", "show", "latest", "--store", runs, cwd=tmp_path)
    made = _contents(people)
    for kept in ("audit", "approvals/approval-", "/run.json", "site.toml", "self-tests"):
        assert any(kept in name for name in made), (kept, made.keys())

    later = _newer(unpacked, tmp_path)
    for bundle, version in ((later, NEWER), (unpacked, "0.1.0")):
        run(*CUT, "sh", bundle / "install.sh", home, cwd=tmp_path, seconds=600)
        assert f"trueflank {version}" in run(*CUT, home / "trueflank", "--version", cwd=tmp_path)
        run(*CUT, home / "trueflank", "check", people / "site.toml", cwd=tmp_path)
        run(*CUT, home / "trueflank", "audit", "verify", runs, cwd=tmp_path)
        assert run(*CUT, home / "trueflank", "runs", "show", "latest", "--store", runs, cwd=tmp_path) == shown
        assert "approved by: ada bob" in _consents(home, version, tmp_path, runs)
        assert _contents(people) == made
    assert sorted(path.name for path in (home / "versions").iterdir()) == ["0.1.0", NEWER]


def test_a_damaged_bundle_installs_nothing(unpacked: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(unpacked, copy)
    wheel = next((copy / "wheels").glob("lark-*.whl"))
    wheel.write_bytes(wheel.read_bytes()[:-1] + b"x")
    told = run("sh", copy / "install.sh", tmp_path / "home", cwd=tmp_path, expect=2)
    assert "nothing was installed" in told
    assert not (tmp_path / "home").exists()


def test_the_archive_for_windows_holds_every_pin_of_its_lock() -> None:
    names = zipfile.ZipFile(_bundle(".zip")).namelist()
    wheels = {name.rsplit("/", 1)[1].split("-")[0].lower().replace("_", "-") for name in names if name.endswith(".whl")}
    lock = (ROOT / "requirements.lock").read_text()
    wanted = {pin.split("==")[0].split("[")[0] for pin in pins(lock, PLATFORMS["windows-amd64"].marker)}
    assert wheels == wanted | {"trueflank"}
    assert "colorama" in wanted
    assert any(name.endswith("/install.cmd") for name in names)


def test_the_system_has_what_cuts_a_network() -> None:
    done = subprocess.run([*CUT, "true"], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
