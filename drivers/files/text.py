"""Bytes of a result file to text: byte order mark, else UTF-8, else the capture PC's code page."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

from drivers.errors import FileFormatError, FileUnreadable

MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
NOTHING = b"\0 \t\r\n" + codecs.BOM_UTF8 + codecs.BOM_UTF16_LE
"""What a file without a word may hold: blanks, line ends, a byte order mark."""
LARGEST_BYTES = 64 << 20
OTHER_CODEPAGES = ("gb18030", "cp1251", "cp1250", "cp932")
SAMPLE, MOSTLY = 400, 0.7


def read_bytes(path: Path) -> bytes:
    """The file's bytes. Raises FileUnreadable (E-FILE-READ), FileFormatError (E-FILE-EMPTY)."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(path), why=str(error)) from error
    if len(data) > LARGEST_BYTES:
        raise FileUnreadable("E-FILE-READ", str(path), why=f"it is larger than {LARGEST_BYTES} bytes")
    if not data.strip(NOTHING):
        raise FileFormatError("E-FILE-EMPTY", str(path), bytes=len(data))
    return data


def decode(data: bytes, codepage: str, where: str) -> str:
    """Text of a file that names no encoding. Raises FileFormatError (E-FILE-ENCODING)."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return _decode(data, encoding, where)
    wide = _unmarked(data)
    if wide:
        return _decode(data, wide, where)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return _decode(data, codepage, where)


def other_texts(data: bytes) -> Iterator[str]:
    """The text as PCs of other countries would read bytes that are no UTF-8; none for those that are."""
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        for codepage in OTHER_CODEPAGES:
            try:
                yield data.decode(codepage)
            except UnicodeDecodeError:
                continue


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


def end_doubts(text: str) -> tuple[str, ...]:
    """A text whose last line has no end may have been cut in the middle of a number."""
    return () if text.endswith(("\n", "\r")) else ("the last line has no line end: is the file whole?",)
