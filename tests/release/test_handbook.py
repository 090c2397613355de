"""The handbook: built without a network, links checked, and its tutorial done as a beginner does it."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.release.placing import ROOT, clean, run

pytestmark = [pytest.mark.release, pytest.mark.timeout(1800)]
BUILDER = ROOT / ".tools" / "bin" / "mkdocs"
BLOCK = re.compile(r"```\n(.*?)```", re.DOTALL)
PAGES = ("tutorial.html", "codes.html", "records.html", "routes.html", "first-day.html", "site-file.html")


def test_the_pages_are_there_and_load_nothing_from_elsewhere() -> None:
    built = ROOT / "dist" / "handbook"
    assert [name for name in PAGES if not (built / name).is_file()] == []
    text = "".join(page.read_text(encoding="utf-8") for page in built.rglob("*.html"))
    loaded = re.findall(r"<(?:script|img|link)[^>]+(?:src|href)=\"(https?://[^\"]+)\"", text)
    assert loaded == []
    assert "E-EXTRA-MISSING" in (built / "codes.html").read_text(encoding="utf-8")
    assert "trueflank_alarms" in (built / "routes.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("link", ["nowhere.md", "push.md#nowhere", "../drivers/nowhere.py"])
def test_a_broken_link_ends_the_build(link: str, tmp_path: Path) -> None:
    for path in ROOT.iterdir():
        if path.name in {"docs", "release"}:
            shutil.copytree(path, tmp_path / path.name)
        elif path.name != "dist":
            (tmp_path / path.name).symlink_to(path)
    page = tmp_path / "docs" / "tutorial.md"
    page.write_text(page.read_text(encoding="utf-8") + f"\n[broken]({link})\n", encoding="utf-8")
    done = subprocess.run([BUILDER, "build"], cwd=tmp_path, env=clean(), capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "nowhere" in done.stdout + done.stderr


def test_the_tutorial_does_what_it_says(tmp_path: Path) -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))
    commands = [shlex.split(line) for block in blocks for line in block.splitlines()]
    assert len(commands) == 8
    program = str(Path(sys.executable).parent / "trueflank")
    assert all(command[0] == "trueflank" for command in commands)
    told = {}
    pipe = subprocess.PIPE
    with subprocess.Popen([program, *commands[0][1:]], cwd=tmp_path, env=clean(), stdin=pipe, stdout=pipe) as machine:
        try:
            assert machine.stdout is not None
            assert b"site.toml" in machine.stdout.readline()
            for command in commands[1:]:
                told[" ".join(command[1:4])] = run(program, *command[1:], cwd=tmp_path, seconds=1500)
        finally:
            machine.terminate()
    assert "passed" in told["doctor self-test site.toml"]
    assert (tmp_path / "runs").is_dir()
    assert list((tmp_path / "runs").rglob("report.html"))
