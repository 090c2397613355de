"""Where each key and each value of a TOML text stands; what stands behind the first thing that is no TOML has none."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass, field
from typing import Any

Path = tuple[str | int, ...]
"""A way into the tree: keys, and numbers of list items."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"[ \t]*")
_EMPTY = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_PLAIN = re.compile(r"[^,\]}#\n]+")
_TEXTS = (
    re.compile(r'"""(?:\\.|[^\\])*?"""+', re.DOTALL),
    re.compile(r"'''.*?'''+", re.DOTALL),
    re.compile(r'"(?:\\.|[^"\\\n])*"'),
    re.compile(r"'[^'\n]*'"),
)


@dataclass(slots=True)
class TextPlaces:
    """Offsets in ``text`` of keys and of values, by their way into the tree."""

    text: str
    keys: dict[Path, int] = field(default_factory=dict)
    values: dict[Path, int] = field(default_factory=dict)

    def of(self, path: Path, *, key: bool = False) -> tuple[int, int] | None:
        """Line and column, from 1, of a value (or its key); of the nearest section around it; None: nowhere."""
        while path:
            first, second = (self.keys, self.values) if key else (self.values, self.keys)
            offset = first.get(path, second.get(path))
            if offset is not None:
                return self.text.count("\n", 0, offset) + 1, offset - (self.text.rfind("\n", 0, offset) + 1) + 1
            path, key = path[:-1], True
        return None


def places_in(text: str) -> TextPlaces:
    """All of a text; what stands behind the first thing that is no TOML has no place."""
    reader = _Reader(text)
    with contextlib.suppress(IndexError, ValueError, RecursionError):
        reader.read()
    return reader.found


class _Reader:
    def __init__(self, text: str) -> None:
        self.found = TextPlaces(text)
        self._text = text
        self._at = 0
        self._tables: dict[Path, int] = {}

    def read(self) -> None:
        around: Path = ()
        self._skip(_EMPTY)
        while self._at < len(self._text):
            if self._text[self._at] == "[":
                around = self._header()
            else:
                self._entry(around)
            self._skip(_EMPTY)

    def _skip(self, what: re.Pattern[str]) -> str:
        match = what.match(self._text, self._at)
        if match is None:
            raise ValueError(self._at)
        self._at = match.end()
        return match.group()

    def _header(self) -> Path:
        start = self._at
        many = self._text.startswith("[[", start)
        self._at += 2 if many else 1
        path: Path = ()
        parts = self._dotted()
        for number, (name, _) in enumerate(parts, start=1):
            path += (name,)
            if many and number == len(parts):
                self._tables[path] = self._tables.get(path, -1) + 1
            self.found.keys.setdefault(path, start)
            if path in self._tables:
                path += (self._tables[path],)
        self.found.keys[path] = start
        self._at += 2 if many else 1
        return path

    def _dotted(self) -> list[tuple[str, int]]:
        """The parts of a key with their offsets; the end stands behind the blanks that follow."""
        parts = []
        while True:
            self._skip(_BLANK)
            start = self._at
            parts.append((self._name(), start))
            self._skip(_BLANK)
            if self._text[self._at] != ".":
                return parts
            self._at += 1

    def _name(self) -> str:
        if self._text[self._at] in "\"'":
            return self._string()[1:-1]
        return self._skip(_BARE)

    def _string(self) -> str:
        for form in _TEXTS:
            if form.match(self._text, self._at):
                return self._skip(form)
        raise ValueError(self._at)

    def _entry(self, around: Path) -> None:
        path = around
        for name, start in self._dotted():
            path += (name,)
            self.found.keys.setdefault(path, start)
        self._at += 1  # the sign of equality
        self._skip(_BLANK)
        self._value(path)

    def _value(self, path: Path) -> None:
        self.found.values[path] = self._at
        first = self._text[self._at]
        if first in "\"'":
            self._string()
        elif first == "[":
            self._list(path)
        elif first == "{":
            self._inline(path)
        else:
            self._skip(_PLAIN)

    def _list(self, path: Path) -> None:
        self._at += 1
        number = 0
        self._skip(_EMPTY)
        while self._text[self._at] != "]":
            self._value((*path, number))
            number += 1
            self._skip(_EMPTY)
            self._at += self._text[self._at] == ","
            self._skip(_EMPTY)
        self._at += 1

    def _inline(self, path: Path) -> None:
        self._at += 1
        self._skip(_EMPTY)
        while self._text[self._at] != "}":
            self._entry(path)
            self._skip(_EMPTY)
            self._at += self._text[self._at] == ","
            self._skip(_EMPTY)
        self._at += 1


def held(tree: Any, path: Path) -> Any:
    """The value at a place of a tree; None where there is none."""
    for part in path:
        try:
            tree = tree[part]
        except (KeyError, IndexError, TypeError):
            return None
    return tree
