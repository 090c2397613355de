"""The bytes of a result file, whole and within bounds, and what is doubtful of its end."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

from drivers.errors import FileFormatError, FileUnreadable
from drivers.message import Message

NOTHING = b"\0 \t\r\n" + codecs.BOM_UTF8 + codecs.BOM_UTF16_LE
"""What a file without a word may hold: blanks, line ends, a byte order mark."""
LARGEST_BYTES = 64 << 20
OTHER_CODEPAGES = ("gb18030", "cp1251", "cp1250", "cp932")


def read_bytes(path: Path) -> bytes:
    """The file's bytes. Raises FileUnreadable (E-FILE-READ), FileFormatError (E-FILE-EMPTY)."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(path), why=str(error)) from error
    if len(data) > LARGEST_BYTES:
        raise FileUnreadable("E-FILE-READ", str(path), why=Message.of("W-FILE-LARGER", largest=LARGEST_BYTES))
    if not data.strip(NOTHING):
        raise FileFormatError("E-FILE-EMPTY", str(path), bytes=len(data))
    return data


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


def plain_minus(text: str) -> str:
    """The text with the minus of typesetters as that of programs."""
    return text.replace("\u2212", "-")


def end_doubts(text: str) -> tuple[Message, ...]:
    """A text whose last line has no end may have been cut in the middle of a number."""
    return () if text.endswith(("\n", "\r")) else (Message.of("S-FILE-END"),)
