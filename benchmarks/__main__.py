"""`python -m benchmarks [--smoke] [--page FILE] [NAME ...]`: run benchmarks, each in a process of its own.

Ends with 1 where a limit is missed. ``--page`` writes the figures with date, commit, machine and load, each benchmark
as soon as it has ended; those that were not run keep their figures.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.report import Figure

NAMES = (
    "flank", "library", "transmission", "ranking", "evaluation", "commands", "store", "dynamic", "streams", "mailbox",
    "push", "page",
)  # fmt: skip
HEAD = """# Benchmarks

<!-- source: ISO 230-2: edition 2014 -->

`make bench` runs them and writes this page. Speed is a ratio of processor times in one process against a floor measured
in the same run, so that neither the computer nor its load decides; a figure beyond its limit fails the run. `make test`
runs the small form of each (`--smoke`), which judges no limit. Each section says when it was run, on what, and under
which load.

"""
PART = re.compile(r"^## (\S+)$", re.MULTILINE)


def ran(name: str, *, smoke: bool) -> tuple[list[Figure], list[str], bool]:
    """One benchmark in a process of its own: its figures, what was left out, whether it kept its limits."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "figures.json"
        command = [sys.executable, "-m", f"benchmarks.{name}", "--json", str(kept), *(["--smoke"] if smoke else [])]
        sys.stdout.write(f"\n{name}\n")
        sys.stdout.flush()
        ended = subprocess.run(command, check=False)  # noqa: S603 - ourselves
        if not kept.exists():
            return [], [f"{name} ended with {ended.returncode} before its last figure"], False
        found = json.loads(kept.read_text("utf-8"))
    return [Figure(**figure) for figure in found["figures"]], found["left_out"], ended.returncode == 0


def section(name: str, begun: str, figures: list[Figure], left_out: list[str]) -> str:
    """One table of the page."""
    doc = (importlib.import_module(f"benchmarks.{name}").__doc__ or name).strip()
    lines = [f"## {name}", "", doc, "", begun, "", "| | measured | limit |", "|---|---|---|"]
    for figure in figures:
        value = f"{figure.value:.3g} {figure.unit}".strip()
        lines.append(f"| {figure.text} | {value}{'' if figure.met else ' **missed**'} | {figure.asked} |")
    return "\n".join([*lines, "", *(f"{text}.\n" for text in left_out)])


def write_page(page: Path, name: str, text: str) -> None:
    """Put one section in its place on the page; the others stay as they are."""
    known = page.read_text(encoding="utf-8") if page.exists() else ""
    places = [(one.start(), one[1]) for one in PART.finditer(known)]
    ends = [*(start for start, _ in places), len(known)][1:]
    parts = {part: known[start:end].rstrip() + "\n" for (start, part), end in zip(places, ends, strict=True)}
    parts[name] = text.rstrip() + "\n"
    page.write_text(HEAD + "\n".join(parts[one] for one in NAMES if one in parts), encoding="utf-8")


def circumstances() -> str:
    """When, which code, on what, under which load."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)  # noqa: S607
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    code = commit.stdout.strip() or "unknown"
    machine = f"{os.cpu_count()} x {_processor()}, Python {platform.python_version()}{load} at the start"
    return f"{datetime.now(UTC):%Y-%m-%d}, commit {code}, {machine}."


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def main() -> int:
    """Run the named benchmarks, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--smoke", action="store_true", help="small sizes, no limit judged")
    parser.add_argument("--page", type=Path, help="write the figures into this page")
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(NAMES))
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; known: {', '.join(NAMES)}")
    missed = []
    for name in options.names or NAMES:
        begun = circumstances()
        figures, left_out, kept = ran(name, smoke=options.smoke)
        missed += [] if kept else [name]
        if options.page:
            write_page(options.page, name, section(name, begun, figures, left_out))
    sys.stdout.write(f"\nlimits missed or not ended: {', '.join(missed) or 'none'}\n")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
