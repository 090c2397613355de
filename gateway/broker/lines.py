"""One JSON object a line in both directions, each of bounded length; what is none ends the conversation."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import Any

LONGEST = 1 << 16


def line(data: Mapping[str, object]) -> bytes:
    """An object as a line."""
    return json.dumps(data, default=str, separators=(",", ":")).encode("ascii") + b"\n"


async def heard(reader: asyncio.StreamReader) -> dict[str, Any] | None:
    """The next object; None once the other side has left, or said something that is none."""
    try:
        text = await reader.readline()
        said = json.loads(text) if text.endswith(b"\n") else None
    except (OSError, ValueError, RecursionError):  # a line too long is a ValueError
        return None
    return said if isinstance(said, dict) else None
