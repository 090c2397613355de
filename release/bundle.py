"""`python -m release.bundle PLATFORM FOLDER SBOM`: one archive that installs trueflank on a PC without a network.

Run by the tools' Python: it evaluates the lock's conditions for the other system. PLATFORM is a name of `PLATFORMS`.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from packaging.markers import Marker

ROOT = Path(__file__).parents[1]
PYTHON = "3.11"
EXTRAS = "sim,report"


@dataclass(frozen=True, slots=True)
class Target:
    """A system: what its conditions say, which wheels run there (best first), its installer and its archive."""

    marker: dict[str, str]
    tags: tuple[str, ...]
    installer: str
    ending: str


PLATFORMS = {
    "linux-x86_64": Target(
        {"sys_platform": "linux", "platform_system": "Linux", "os_name": "posix", "platform_machine": "x86_64"},
        ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
        "install.sh",
        "tar.gz",
    ),
    "windows-amd64": Target(
        {"sys_platform": "win32", "platform_system": "Windows", "os_name": "nt", "platform_machine": "AMD64"},
        ("win_amd64",),
        "install.cmd",
        "zip",
    ),
}


def pins(lock: str, marker: dict[str, str]) -> Iterator[str]:
    """The pins of a lock that hold on a system, their conditions taken away, each with its hashes."""
    given = {
        "python_version": PYTHON,
        "python_full_version": f"{PYTHON}.0",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        **marker,
    }
    for block in lock.strip().replace("\\\n", " ").splitlines():
        pin, *hashes = block.split(" --hash=")
        name, _, condition = pin.partition(" ; ")
        if not condition or Marker(condition.strip()).evaluate(given):
            yield " ".join([name.strip(), *(f"--hash={one.strip()}" for one in hashes)])


def sha256(path: Path) -> str:
    """The hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def fill(folder: Path, target: Target, sbom: Path) -> None:
    """Put wheels, lock, installer, bill of material and sums into a folder."""
    wheels = folder / "wheels"
    lock = folder / "requirements.lock"
    found = list(pins((ROOT / "requirements.lock").read_text(encoding="utf-8"), target.marker))
    lock.write_text("\n".join(found) + "\n", encoding="utf-8")
    tags = [word for tag in target.tags for word in ("--platform", tag)]
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--require-hashes", "--only-binary", ":all:"]
    own = [*tags, "--python-version", PYTHON, "--implementation", "cp", "-d", str(wheels), "-r", str(lock)]
    subprocess.run([*pip, *own], check=True)
    (ours,) = (ROOT / "dist").glob("trueflank-*.whl")
    version = ours.name.split("-")[1]
    shutil.copy(ours, wheels)
    with lock.open("a", encoding="utf-8") as more:
        more.write(f"trueflank[{EXTRAS}]=={version} --hash=sha256:{sha256(ours)}\n")
    for name in (ROOT / "release" / target.installer, ROOT / "docs" / "licences.md", ROOT / "CHANGELOG.md", sbom):
        shutil.copy(name, folder)
    (folder / "VERSION").write_text(version + "\n", encoding="utf-8")
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sums = [f"{sha256(path)}  {path.relative_to(folder).as_posix()}" for path in files]
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def packed(folder: Path, archive: Path) -> None:
    """Make the archive of a folder, under the folder's name."""
    if archive.name.endswith(".zip"):
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as zipped:
            for path in sorted(folder.rglob("*")):
                zipped.write(path, path.relative_to(folder.parent))
        return
    with tarfile.open(archive, "w:gz") as tar:
        tar.add(folder, folder.name)


def main(arguments: list[str]) -> int:
    """Make one archive; prints its name and size."""
    platform, place, sbom = arguments[0], Path(arguments[1]), Path(arguments[2])
    target = PLATFORMS[platform]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / f"trueflank-{platform}"
        folder.mkdir()
        fill(folder, target, sbom)
        version = (folder / "VERSION").read_text(encoding="utf-8").strip()
        archive = place / f"trueflank-{version}-{platform}-py{PYTHON.replace('.', '')}.{target.ending}"
        packed(folder, archive)
    print(f"bundle: {archive} ({archive.stat().st_size / 1e6:.0f} MB, {sha256(archive)})")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
