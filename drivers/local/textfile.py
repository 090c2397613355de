"""Texts from files: bytes without a named encoding, and TOML that a person wrote, both within bounds."""

from __future__ import annotations

import codecs
import re
import stat
import tomllib
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from drivers.errors import FileFormatError, words
from drivers.local.names import shown

# Bytes that name no encoding to text: byte order mark, else UTF-16 by its look, else UTF-8, else a code page.

MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
SAMPLE, MOSTLY = 400, 0.7
MOST_LINES, LONGEST_LINE = 2_000_000, 1 << 20


def decode_text(data: bytes, codepage: str, where: str) -> str:
    """Text of a file that names no encoding. Raises FileFormatError (E-FILE-ENCODING, E-FILE-LINES)."""
    _bear(data, where)
    told = _told(data)
    if told:
        return _decode(data, told, where)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return _decode(data, codepage, where)


def _bear(data: bytes, where: str) -> None:
    """Lines that nobody's software writes are refused before anything looks into them."""
    mark = b"\n" if b"\n" in data else b"\r"
    longest = len(data) > LONGEST_LINE and max(map(len, data.split(mark))) if data.count(mark) <= MOST_LINES else 0
    if data.count(mark) > MOST_LINES or longest > LONGEST_LINE:
        raise FileFormatError("E-FILE-LINES", where, most=MOST_LINES, longest=LONGEST_LINE)


def decode_beginning(data: bytes, codepage: str) -> str:
    """Text of the first bytes of a file, for people to look at: the same choice, a letter cut at the end left out."""
    told = _told(data)
    try:
        return codecs.getincrementaldecoder(told or "utf-8")().decode(data)
    except UnicodeDecodeError:
        return data.decode(told or codepage, "replace")


def _told(data: bytes) -> str:
    """The encoding that a mark or the look of the bytes tells, "" for neither."""
    marked = (encoding for mark, encoding in MARKS if data.startswith(mark))
    return next(marked, "") or _unmarked(data)


def _unmarked(data: bytes) -> str:
    """UTF-16 without its mark, by the empty half of nearly every letter; "" for any other text."""
    head = data[:SAMPLE]
    halves = head[0::2], head[1::2]
    empty = [half.count(0) / len(half) if half else 0.0 for half in halves]
    if len(data) % 2 or abs(empty[0] - empty[1]) < MOSTLY:
        return ""
    return "utf-16-be" if empty[0] > empty[1] else "utf-16-le"


def _decode(data: bytes, encoding: str, where: str) -> str:
    try:
        return data.decode(encoding)
    except (UnicodeDecodeError, LookupError) as error:
        raise FileFormatError("E-FILE-ENCODING", where, encoding=encoding, why=str(error)) from error


# A TOML file that a person wrote, read within bounds: what is too large or too deep is refused like a wrong line.

MOST_BYTES = 1 << 20
MOST_KEYS, MOST_PARTS = 5_000, 32
"""How many keys and headings a file may have, and a key parts: what judges them takes its time for each."""
_HEAD = re.compile(r"\s*\[{1,2}\s*[\w\"'][^,=]*\]")
_MARK = b"\xef\xbb\xbf"
_WIDEST = (b"\xff\xfe\0\0", b"\0\0\xfe\xff")
_WIDE = (b"\xff\xfe", b"\xfe\xff")


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tree. Raises OSError when it cannot be read, ValueError when it is no TOML of a bearable size."""
    return parse_toml(decode_utf8(read_bounded(path)))


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


def decode_utf8(data: bytes) -> str:
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
        for path, value in find_bad_numbers(tree):
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


def find_bad_numbers(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], object]]:
    """Numbers that are none, with their ways into the tree: nan, infinite, or beyond the 64 bits of TOML's integers."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from find_bad_numbers(item, (*path, key))
    elif isinstance(value, float | int) and not (
        isfinite(value) if isinstance(value, float) else abs(value) >> 63 == 0
    ):
        yield path, value
