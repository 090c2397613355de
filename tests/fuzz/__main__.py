"""`python -m tests.fuzz SECONDS FOLDER [NAME...]`: search every parser for so many seconds of the processor each.

What is found is kept in the folder, one file an input, and ends with 1. Memory is limited: more than 2 GB is a finding.
"""

from __future__ import annotations

import logging
import sys
import time
from pathlib import Path

from tests.fuzz.engine import search
from tests.fuzz.targets import targets

MEMORY_BYTES = 2 << 30


def limit_memory() -> None:
    """So that an input that asks for too much raises MemoryError, where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))


def main(seconds: float, folder: Path, names: list[str]) -> int:
    """Search, keep, and say; 1 where anything was found."""
    limit_memory()
    logging.disable(logging.CRITICAL)
    bad = 0
    for name, (read, seeds) in targets().items():
        if names and name not in names:
            continue
        end = time.process_time() + seconds
        found = search(read, seeds, int(time.time()), lambda _count, end=end: time.process_time() < end)  # noqa: TID251 - a new seed each time
        print(
            f"{name}: {found.tried} inputs, {len(found.ways)} ways, {len(found.kept)} kept, "
            f"{found.accepted} read, {sum(found.refused.values())} refused, {len(found.findings)} findings",
            flush=True,
        )
        for one in found.findings:
            place = folder / name.replace(" ", "-")
            place.mkdir(parents=True, exist_ok=True)
            (place / one.name).write_bytes(one.data)
            print(f"  {one.why}\n  {place / one.name}", flush=True)
        bad += len(found.findings)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]))
