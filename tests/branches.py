"""Branch coverage of the packages that decide about a write, by their unit tests and the quick tests of pushes.

`python -m tests.branches PAGE` runs these tests once and writes the figures into the page, with every line and branch
that no test takes. One that none can take has its reason here: `REASONS`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("gateway/push", "gateway/interlocks", "gateway/audit")
TESTS = ("tests/unit/push", "tests/unit/interlocks", "tests/unit/audit", "tests/unit/approve", "tests/push")
QUICK = "not soak and not interop and not long and not services and not browser and not release"
SECTION = "\n## Branches"
REASONS: dict[str, str] = {}
"""Why no test takes a line or branch, by the name of its file and the text of the line."""


def measured() -> dict[str, Any]:
    """What coverage.py says, as its own JSON. Raises CalledProcessError where the tests fail."""
    with tempfile.TemporaryDirectory() as scratch:
        data, told = f"{scratch}/data", f"{scratch}/told.json"
        run = [sys.executable, "-m", "coverage"]
        source = ",".join(PACKAGES)
        tests = ["-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-m", QUICK, *TESTS]
        subprocess.run(
            [*run, "run", f"--data-file={data}", "--branch", f"--source={source}", *tests], cwd=ROOT, check=True
        )
        subprocess.run([*run, "json", "-q", f"--data-file={data}", "-o", told], cwd=ROOT, check=True)
        found: dict[str, Any] = json.loads(Path(told).read_text(encoding="utf-8"))
        return found


def share(files: Mapping[str, Any], package: str) -> tuple[int, int, int, int]:
    """Statements and branches of a package: (taken, all) of each."""
    sums = [one["summary"] for name, one in files.items() if name.startswith(f"{package}/")]
    keys = ("covered_lines", "num_statements", "covered_branches", "num_branches")
    lines, statements, taken, branches = (sum(one[key] for one in sums) for key in keys)
    return lines, statements, taken, branches


def left(files: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Every line and branch that no test takes, as (place with its line, reason or "")."""
    found = []
    for name, one in files.items():
        text = (ROOT / name).read_text(encoding="utf-8").splitlines()
        lines = sorted({*one["missing_lines"], *(abs(begin) for begin, _ in one["missing_branches"])})
        for line in lines:
            said = text[line - 1].strip()
            found.append((f"{name}: `{said[:90]}`", REASONS.get(f"{name}: {said}", "")))
    return found


def page_of(files: Mapping[str, Any]) -> str:
    """The section of the page."""
    rows = [
        SECTION.strip(),
        "",
        "Taken by the unit tests of the packages and the quick tests of pushes. Repeat with `make coverage`.",
        "",
    ]
    rows += ["| package | statements | branches |", "|---|---:|---:|"]
    for package in PACKAGES:
        lines, statements, taken, branches = share(files, package)
        rows.append(f"| `{package}` | {_part(lines, statements)} | {_part(taken, branches)} |")
    every = left(files)
    bare = [place for place, why in every if not why]
    rows += ["", f"Not taken, with a reason: {len(every) - len(bare)}; without one: {len(bare)}.", ""]
    rows += [f"- {place}" + (f": {why}" if why else "") for place, why in every]
    return "\n".join(rows).rstrip() + "\n"


def _part(some: int, every: int) -> str:
    return f"{100.0 * some / every:.1f} % of {every}" if every else "-"


def main(page: Path) -> int:
    """Measure and write."""
    told = page_of(measured()["files"])
    text = page.read_text(encoding="utf-8")
    head, _, rest = text.partition(SECTION)
    after = rest[rest.index("\n## ") :] if "\n## " in rest else ""
    page.write_text(f"{head.rstrip()}\n\n{told}{after}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
