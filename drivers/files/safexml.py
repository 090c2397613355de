"""XML as a stream of elements, read so that no file can harm: no DTD, no entities, bounded size, depth and number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NoReturn
from xml.parsers import expat

from drivers.errors import FileFormatError
from drivers.message import Message

MOST_BYTES = 32 << 20
DEEPEST = 50
MOST_ELEMENTS = 1_000_000
LONGEST_TEXT = 8 << 20
CHUNK = 1 << 16


@dataclass(slots=True)
class Element:
    """One element while it is open: local name, attributes, text, its children's texts by name, its line."""

    name: str
    attributes: dict[str, str]
    line: int
    text: list[str] = field(default_factory=list)
    children: dict[str, str] = field(default_factory=dict)

    def look_up(self, name: str) -> str | None:
        """ "@name" an attribute, "name" the text of a child (the last of its name)."""
        return self.attributes.get(name[1:]) if name.startswith("@") else self.children.get(name)


Ended = Callable[[Element, list[Element]], None]


class _Reader:
    def __init__(self, ended: Ended, where: str) -> None:
        self._ended = ended
        self._where = where
        self._open: list[Element] = []
        self._count = 0
        self._letters = 0
        self.parser = expat.ParserCreate(None)
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        for name in ("StartDoctypeDecl", "EntityDecl", "UnparsedEntityDecl", "NotationDecl", "ExternalEntityRef"):
            setattr(self.parser, f"{name}Handler", self._forbidden)

    def _forbidden(self, *_declared: Any) -> NoReturn:
        raise FileFormatError("E-FILE-XML-DTD", self._where, line=self.parser.CurrentLineNumber)

    def _too_much(self, what: str | Message, limit: int) -> NoReturn:
        line = self.parser.CurrentLineNumber
        raise FileFormatError("E-FILE-XML-LIMIT", self._where, what=what, limit=limit, line=line)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MOST_ELEMENTS:
            self._too_much("elements", MOST_ELEMENTS)
        if len(self._open) >= DEEPEST:
            self._too_much(Message.of("W-FILE-NESTED"), DEEPEST)
        named = {local(key): value for key, value in attributes.items()}
        self._open.append(Element(local(name), named, self.parser.CurrentLineNumber))

    def _text(self, text: str) -> None:
        self._letters += len(text)
        if self._letters > LONGEST_TEXT:
            self._too_much(Message.of("W-FILE-LETTERS"), LONGEST_TEXT)
        if self._open:
            self._open[-1].text.append(text)

    def _end(self, _name: str) -> None:
        element = self._open.pop()
        if self._open:
            self._open[-1].children[element.name] = "".join(element.text).strip()
        self._ended(element, self._open)


def local(name: str) -> str:
    """A name without its namespace prefix."""
    return name.rpartition(":")[2]


def read_elements(data: bytes, ended: Ended, where: str) -> None:
    """Call ``ended(element, its open ancestors, outermost first)`` at each element's end.

    Raises FileFormatError: E-FILE-XML (not well-formed, with line), E-FILE-XML-DTD, E-FILE-XML-LIMIT.
    """
    if len(data) > MOST_BYTES:
        raise FileFormatError("E-FILE-XML-LIMIT", where, what="bytes", limit=MOST_BYTES, line=1)
    reader = _Reader(ended, where)
    try:
        for start in range(0, len(data), CHUNK):
            reader.parser.Parse(data[start : start + CHUNK], False)
        reader.parser.Parse(b"", True)
    except expat.ExpatError as error:
        why = expat.errors.messages.get(error.code, str(error))
        raise FileFormatError("E-FILE-XML", where, line=error.lineno, why=why) from error
    except (LookupError, ValueError) as error:
        raise FileFormatError("E-FILE-XML", where, line=reader.parser.CurrentLineNumber, why=str(error)) from error
