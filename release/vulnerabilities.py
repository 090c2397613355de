"""`python -m release.vulnerabilities TOOLS LOCK`: asks public data bases of known weaknesses for every pinned version.

Ends with 1 where one is known. Where no data base can be reached, or none knows the packages, it says NOT CHECKED and
ends with 1 too: an unasked question is no answer. Who has no network asks for 0 with TRUEFLANK_VULNERABILITIES=offline.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

SERVICES = ("osv", "pypi")
PATIENCE_S = 300


def told(answer: str) -> tuple[int, int, list[str]]:
    """How many packages were asked for, how many the data base knows, and what it knows against them."""
    packages: list[dict[str, Any]] = json.loads(answer)["dependencies"]
    known = [one for one in packages if "skip_reason" not in one]
    found = [
        f"{one['name']} {one['version']}: {weak['id']}, mended in {', '.join(weak['fix_versions']) or 'no version'}"
        for one in known
        for weak in one["vulns"]
    ]
    return len(packages), len(known), found


def asked(tools: Path, lock: Path, service: str) -> tuple[int, int, list[str]]:
    """Ask one data base; nothing known where it cannot be reached."""
    program = next(one for one in (tools / "bin" / "pip-audit", tools / "Scripts" / "pip-audit.exe") if one.exists())
    command = [
        program,
        "--require-hashes",
        "--disable-pip",
        "--progress-spinner=off",
        "-s",
        service,
        "-f",
        "json",
        "-r",
        lock,
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        return told(done.stdout)
    except (ValueError, subprocess.TimeoutExpired):
        return 0, 0, []


def main(arguments: list[str]) -> int:
    """Ask one data base after the other until one knows the packages."""
    for service in SERVICES:
        count, known, found = asked(Path(arguments[0]), Path(arguments[1]), service)
        for line in found:
            print(f"vulnerabilities: {line}")
        if known:
            print(f"vulnerabilities: {len(found)} known in {known} of {count} packages, by {service}")
            return 1 if found or known < count else 0
    print(
        f"vulnerabilities: NOT CHECKED: no data base could be reached that knows these packages ({', '.join(SERVICES)})"
    )
    return 0 if os.environ.get("TRUEFLANK_VULNERABILITIES") == "offline" else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
