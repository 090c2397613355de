"""What attacks on a push found: each family of attacks counts its tries here, and the page is written from the counts.

A test calls `judged` or `counted` once it has judged its tries. Counts of one run stand in a folder
(`TRUEFLANK_ATTACKS`), one file a process. `python -m tests.attacks FOLDER PAGE COMMAND` adds them up: `make attacks`.
"""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

HEAD = """# Attacks on a push, counted

Written by the tests themselves on {date}, with Python {python}, trueflank {version}. Repeat with `{command}`.

A *wrong table* is one that was enabled, at any change of the control's memory, and was neither the old table nor
the new one, while the control itself did what it was told; or one that was left enabled at the end, and the gateway
did not say "held, still on". A *false word* is an outcome, a journal, an audit record or a finding that is not true of
the control's memory, switch and acting curve. The judge reads the simulated control, never the gateway.

What this does not prove: the simulated control is a reading of manuals. No real control was attacked.

| attack | on | tries | wrong tables | false words |
|---|---|---:|---:|---:|
"""


BY_HAND = "\n## "
"""What stands on the page from here on is no count of attacks."""

# What the judge of the pushes says of a wrong table (`tests/push/oracle.py`); all else that is wrong is a word.
WRONG_TABLE = ("neither the old nor the new table", "a torn table")


@dataclass(frozen=True)
class Count:
    """One family of attacks on one road: how often it was tried and what went wrong."""

    family: str
    road: str
    tries: int
    wrong_tables: int = 0
    false_words: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(
            self.family,
            self.road,
            self.tries + other.tries,
            self.wrong_tables + other.wrong_tables,
            self.false_words + other.false_words,
        )


def counted(family: str, road: str, tries: int, *, wrong_tables: int = 0, false_words: int = 0) -> None:
    """Note a family's tries, before the test asserts on them, so that a failure is on the page too."""
    folder = os.environ.get("TRUEFLANK_ATTACKS")
    if not folder:
        return
    Path(folder).mkdir(parents=True, exist_ok=True)
    one = {
        "family": family,
        "road": road,
        "tries": tries,
        "wrong_tables": wrong_tables,
        "false_words": false_words,
    }
    with (Path(folder) / f"{os.getpid()}.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps(one) + "\n")


def judged(family: str, road: str, wrong: Iterable[Iterable[str]]) -> None:
    """Note a family's tries, each given by what was wrong with it (nothing: it was as it should be)."""
    told = [" ".join(one) for one in wrong]
    tables = sum(any(word in one for word in WRONG_TABLE) for one in told)
    false = sum(bool(one) for one in told) - tables
    counted(family, road, len(told), wrong_tables=tables, false_words=false)


def added(folder: Path) -> tuple[Count, ...]:
    """All counts of a run, one a family and road, in the order of their names."""
    found: dict[tuple[str, str], Count] = {}
    for path in sorted(folder.glob("*.jsonl")):
        for line in path.read_text(encoding="utf-8").splitlines():
            one = Count(**json.loads(line))
            key = (one.family, one.road)
            found[key] = found[key] + one if key in found else one
    return tuple(found[key] for key in sorted(found))


def page(counts: Iterable[Count], told: Mapping[str, str]) -> str:
    """The page as Markdown; ``told`` fills the head (date, python, version, command)."""
    counts = tuple(counts)
    rows = [_row(one.family, one.road, one) for one in counts]
    total = Count("", "", 0)
    for one in counts:
        total += one
    return HEAD.format(**told) + "\n".join([*rows, _row("**all**", "", total), ""])


def _row(family: str, road: str, one: Count) -> str:
    tries = f"{one.tries:,}".replace(",", " ")
    return f"| {family} | {road} | {tries} | {one.wrong_tables} | {one.false_words} |"


def main(folder: str, target: str, command: str) -> int:
    """Write the page, and leave what was measured by hand below it; 1 where anything was wrong or nothing counted."""
    counts = added(Path(folder))
    told = {
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        "version": metadata.version("trueflank"),
        "command": command,
    }
    place = Path(target)
    before = place.read_text(encoding="utf-8") if place.exists() else ""
    by_hand = before[before.index(BY_HAND) :] if BY_HAND in before else ""
    place.write_text(page(counts, told) + by_hand, encoding="utf-8")
    print(f"{target}: {sum(one.tries for one in counts)} tries")
    return int(not counts or any(one.wrong_tables or one.false_words for one in counts))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
