"""A TOML file that a person wrote, read within bounds: what is too large or too deep is refused like a wrong line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from drivers.errors import words

MOST_BYTES = 1 << 20


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tree. Raises OSError when it cannot be read, ValueError when it is no TOML of a bearable size."""
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise OSError(words("W-TOML-LARGE", limit=MOST_BYTES))
    return parse_toml(data.decode("utf-8"))


def parse_toml(text: str) -> dict[str, Any]:
    """The tree of a text. Raises ValueError, for brackets nested beyond reason too."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(words("W-TOML-DEEP")) from error
