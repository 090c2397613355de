"""A TOML file that a person wrote, read within bounds: what is too large or too deep is refused like a wrong line."""

from __future__ import annotations

import re
import stat
import tomllib
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.local.names import shown

MOST_BYTES = 1 << 20
MOST_KEYS, MOST_PARTS = 5_000, 32
"""How many keys and headings a file may have, and a key parts: what judges them takes its time for each."""
_HEAD = re.compile(r"\s*\[{1,2}\s*[\w\"'][^,=]*\]")
_MARK = b"\xef\xbb\xbf"
_WIDEST = (b"\xff\xfe\0\0", b"\0\0\xfe\xff")
_WIDE = (b"\xff\xfe", b"\xfe\xff")


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tree. Raises OSError when it cannot be read, ValueError when it is no TOML of a bearable size."""
    return parse_toml(decoded(read_bounded(path)))


def read_bounded(path: Path) -> bytes:
    """The bytes of a file of a bearable size; a folder, a pipe and a large file are refused at once. Raises OSError."""
    kind = path.stat()
    if stat.S_ISDIR(kind.st_mode):
        raise IsADirectoryError(words("W-TOML-FOLDER"))
    if not stat.S_ISREG(kind.st_mode):
        raise OSError(words("W-TOML-NO-FILE"))
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1) if kind.st_size <= MOST_BYTES else b""
    if kind.st_size > MOST_BYTES or len(data) > MOST_BYTES:
        raise OSError(words("W-TOML-LARGE", limit=MOST_BYTES))
    return data


def decoded(data: bytes) -> str:
    """The text of UTF-8 bytes, without the mark some editors write first. Raises ValueError naming what it is else."""
    if data.startswith(_WIDEST):
        raise ValueError(words("W-TOML-UTF32"))
    if data.startswith(_WIDE) or _every_second(data[:400]):
        raise ValueError(words("W-TOML-UTF16"))
    if b"\0" in data:
        raise ValueError(words("W-TOML-BINARY"))
    try:
        return data.removeprefix(_MARK).decode("utf-8")
    except UnicodeDecodeError as error:
        before = error.object[: error.start]
        line, column = before.count(b"\n") + 1, len(before) - (before.rfind(b"\n") + 1) + 1
        letter = error.object[error.start : error.start + 1]
        seen = shown(letter.decode("cp1252", "replace"))
        raise ValueError(
            words("W-TOML-LATIN", byte=f"0x{letter.hex()}", letter=seen, line=line, column=column)
        ) from error


def _every_second(data: bytes) -> bool:
    """Whether about every second byte is empty, and never the one beside it: letters of UTF-16 without its mark."""
    halves = (data[::2].count(0), data[1::2].count(0))
    return max(halves) > len(data) // 4 and min(halves) == 0


def parse_toml(text: str) -> dict[str, Any]:
    """The tree of a text. Raises ValueError, for brackets nested beyond reason and infinite numbers too."""
    bear(text)
    try:
        tree = tomllib.loads(text)
        for path, value in no_numbers(tree):
            raise ValueError(words("W-TOML-NUMBER", key=shown(".".join(map(str, path))), value=shown(value)))
    except RecursionError as error:
        raise ValueError(words("W-TOML-DEEP")) from error
    return tree


def bear(text: str) -> None:
    """Raises ValueError for a text with more keys, or a key of more parts, than anybody writes."""
    keys = 0
    for line in text.split("\n"):
        if line.lstrip().startswith("#"):
            continue
        key, equals, _value = line.partition("=")
        if not equals and (head := _HEAD.match(line)):
            key, equals = head[0], "="
        keys += line.count("=") or bool(equals)
        if equals and "," not in key and key.count(".") >= MOST_PARTS:
            raise ValueError(words("W-TOML-PARTS", limit=MOST_PARTS))
    if keys > MOST_KEYS:
        raise ValueError(words("W-TOML-KEYS", limit=MOST_KEYS))


def no_numbers(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], object]]:
    """Numbers that are none, with their ways into the tree: nan, infinite, or beyond the 64 bits of TOML's integers."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from no_numbers(item, (*path, key))
    elif isinstance(value, float | int) and not (
        isfinite(value) if isinstance(value, float) else abs(value) >> 63 == 0
    ):
        yield path, value
