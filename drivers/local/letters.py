"""Bytes that name no encoding to text: byte order mark, else UTF-16 by its look, else UTF-8, else a code page."""

from __future__ import annotations

import codecs

from drivers.errors import FileFormatError

MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
SAMPLE, MOSTLY = 400, 0.7
MOST_LINES, LONGEST_LINE = 2_000_000, 1 << 20


def decode(data: bytes, codepage: str, where: str) -> str:
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


def beginning(data: bytes, codepage: str) -> str:
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
