"""The log's records as data, for people to read; a damaged line is shown as such and hides no other."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gateway.audit.chain import AUDIT, content, files
from gateway.audit.entries import head_of_line


def entries(root: Path) -> Iterator[dict[str, Any]]:
    """Every record in order as JSON data; ``damaged`` is true where a line does not match its own hash."""
    for path in files(root / AUDIT):
        lines = content(path).split(b"\n")[:-1]
        for number, line in enumerate(lines, 1):
            yield _entry(line, f"{path.name}:{number}")


def _entry(line: bytes, place: str) -> dict[str, Any]:
    if head_of_line(line) is None:
        return {"place": place, "damaged": True, "text": line.decode("ascii", "replace")}
    return {**json.loads(line), "place": place, "damaged": False}
