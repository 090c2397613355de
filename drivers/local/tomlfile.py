"""A TOML file that a person wrote, read within bounds: what is too large or too deep is refused like a wrong line."""

from __future__ import annotations

import tomllib
from math import isfinite
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.local.names import shown

MOST_BYTES = 1 << 20


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tree. Raises OSError when it cannot be read, ValueError when it is no TOML of a bearable size."""
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise OSError(words("W-TOML-LARGE", limit=MOST_BYTES))
    return parse_toml(data.decode("utf-8"))


def parse_toml(text: str) -> dict[str, Any]:
    """The tree of a text. Raises ValueError, for brackets nested beyond reason and infinite numbers too."""
    try:
        tree = tomllib.loads(text)
        _check(tree, "")
    except RecursionError as error:
        raise ValueError(words("W-TOML-DEEP")) from error
    return tree


def _check(value: Any, key: str) -> None:
    """Raises ValueError for a number that is none: nan, infinite, or beyond the 64 bits that TOML gives integers."""
    if isinstance(value, dict):
        for name, item in value.items():
            _check(item, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for item in value:
            _check(item, key)
    elif isinstance(value, float | int) and not (
        isfinite(value) if isinstance(value, float) else abs(value) >> 63 == 0
    ):
        raise ValueError(words("W-TOML-NUMBER", key=shown(key), value=shown(value)))
