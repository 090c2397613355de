"""What stands before the words of a block: skip sign, block number, label; and the file's own first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.names import bare_name, judge_name, judge_program_name
from drivers.sinumerik.legality.statements import JUMPS

_HEADER = re.compile(r"%(?P<name>[A-Z0-9_]+_[A-Z0-9]{3})[ \t\r]*", re.ASCII | re.IGNORECASE)
_PATH = re.compile(r";\$PATH=(?:/_N_[A-Z0-9_]+_(?:DIR|WPD))+[ \t\r]*", re.ASCII)
_LONGEST_NUMBER = 8


@dataclass(frozen=True)
class BlockHead:
    """Skip sign or not, block number ("N10", ":10" or nothing), label (or nothing)."""

    skipped: bool
    number: str
    label: str


def head(cursor: Cursor) -> BlockHead:
    """Read the head of a block; a wrong label is noted and kept. Raises Illegal for a wrong block number."""
    skipped = _skip(cursor)
    number = _number(cursor)
    label = ""
    if cursor.after.text == ":" and cursor.token.kind in ("name", "din") and cursor.token.text not in JUMPS:
        label = cursor.take().text
        cursor.take()
        try:
            judge_name(label, "label")
        except Illegal as wrong:
            cursor.noted.append(wrong)
    return BlockHead(skipped, number, label)


def judge_header(line: str, name: str) -> None:
    """Raise Illegal unless %_N_NAME_MPF names this program (``name`` may be unknown: "")."""
    match = _HEADER.fullmatch(line)
    if match is None:
        raise Illegal("E-LEGAL-HEADER", line=line[:40])
    judge_program_name(match["name"])
    if name and bare_name(match["name"]) != bare_name(name):
        raise Illegal("E-LEGAL-HEADER-NAME", given=match["name"], name=name)


def judge_path(line: str, behind_header: bool) -> None:
    """;$PATH= stands right behind the header, from the first column, and names directories from the root."""
    if not behind_header or not _PATH.fullmatch(line):
        raise Illegal("E-LEGAL-PATH", line=line.strip()[:40])


def _skip(cursor: Cursor) -> bool:
    """/ or /0 to /9."""
    if not cursor.accept("/"):
        return False
    if cursor.token.kind == "number":
        level = cursor.take().text
        if len(level) > 1:
            raise Illegal("E-LEGAL-BLOCK-NUMBER", text=f"/{level}")
    return True


def _number(cursor: Cursor) -> str:
    """N10, or :10 for a main block."""
    token = cursor.token
    if cursor.accept(":"):
        digits = cursor.take().text
        _judge_number(f":{digits}", digits)
        return f":{digits}"
    if token.kind == "din" and token.text[0] == "N" and cursor.after.text not in ("=", ":"):
        cursor.take()
        _judge_number(token.text, token.text[1:])
        return f"N{int(token.text[1:])}"
    return ""


def _judge_number(text: str, digits: str) -> None:
    if not digits.isdigit() or len(digits) > _LONGEST_NUMBER:
        raise Illegal("E-LEGAL-BLOCK-NUMBER", text=text)
