"""Whole commands in processes of their own: processor time and memory, from the first import to the exit."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

from benchmarks.evaluation import written
from benchmarks.report import Report, child, main

ASKED = 20
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def started(report: Report, text: str, words: list[str], limit_s: float, limit_mb: float, folder: Path) -> None:
    """One command, the best of three."""
    runs = [child(words, folder=folder) for _ in range(report.pick(3, 1))]
    if any(run.code for run in runs):
        raise SystemExit(f"{' '.join(words)} ended with {max(run.code for run in runs)}")
    report.at_most(f"{text}: processor", min(run.cpu_s for run in runs), limit_s, "s")
    report.at_most(f"{text}: memory", min(run.memory_mb for run in runs), limit_mb, "MB")


def grinder(folder: Path) -> Path:
    """The site of a grinder with a part, and the files that it names."""
    folder.mkdir()
    text = (EXAMPLES / "sites" / "opcua-grinder.toml").read_text(encoding="utf-8")
    (folder / "site.toml").write_text(text.replace("../gears", str(EXAMPLES / "gears")), encoding="utf-8")
    (folder / "password.txt").write_text("secret\n", encoding="ascii")
    (folder / "password.txt").chmod(0o600)
    (folder / "control.der").write_bytes(b"\x30\x82")
    return folder / "site.toml"


def service(report: Report, folder: Path) -> None:
    """What the service holds beside a cell that nobody asks for anything, after its first page was fetched."""
    folder.mkdir()
    site = folder / "site.toml"
    with (
        spoken("-m", "simulators.cell", "demo", "--site", str(site)),
        spoken("-m", "gateway.cli", "serve", str(site), "--port", "0") as (said, running),
    ):
        url = next(word for word in said.split() if word.startswith("http"))
        for _ in range(ASKED):
            with urlopen(url) as answer:  # noqa: S310 - our own on loopback
                answer.read()
        held = Path(f"/proc/{running.pid}/status").read_text(encoding="ascii")
    kilobytes = float(next(line.split()[1] for line in held.splitlines() if line.startswith("VmRSS")))
    report.at_most("service beside a cell, idle: memory", kilobytes / 1024.0, 120.0, "MB")


@contextmanager
def spoken(*words: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A process of ours that runs until the end of the block, and its first line."""
    pipe, null = subprocess.PIPE, subprocess.DEVNULL
    command = [sys.executable, *words]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=null, text=True) as process:  # noqa: S603 - ourselves
        try:
            yield process.stdout.readline() if process.stdout is not None else "", process
        finally:
            process.terminate()


def measure(report: Report) -> None:
    """All figures of this file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        site = shutil.copy(EXAMPLES / "sites" / "files-only.toml", folder / "site.toml")
        one = written(folder / "one.rtl", 1)
        started(report, "trueflank --help", ["--help"], 0.3, 60.0, folder)
        if report.smoke:
            return
        started(report, "check SITE", ["check", str(site)], 0.4, 120.0, folder)
        started(report, "check SITE that grinds", ["check", str(grinder(folder / "grinder"))], 0.4, 130.0, folder)
        started(report, "runs list, empty store", ["runs", "list"], 0.3, 90.0, folder)
        started(report, "evaluate FILE.rtl", ["evaluate", str(one)], 0.6, 150.0, folder)
        ten = [str(written(folder / f"ten-{number}.rtl", number)) for number in range(10)]
        started(report, "evaluate, ten files", ["evaluate", *ten], 1.0, 150.0, folder)
        started(report, "report FILE.rtl (PDF, HTML, data)", ["report", str(one)], 1.2, 250.0, folder)
        service(report, folder / "service")


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
