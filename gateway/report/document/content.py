"""What a document is made of: frozen blocks in reading order; PDF and HTML are two renderings of the same records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

Look = Literal["body", "small", "strong"]
State = Literal["good", "bad", "open", "plain"]
Row = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading: level 1 opens a section, 2 a part of it."""

    kind: ClassVar[str] = "heading"
    text: str
    level: Literal[1, 2] = 1


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A sentence or more."""

    kind: ClassVar[str] = "paragraph"
    text: str
    look: Look = "body"


@dataclass(frozen=True, slots=True)
class FactsBlock:
    """Names and values in columns; what is "" is not shown."""

    kind: ClassVar[str] = "facts"
    rows: tuple[tuple[str, str], ...]
    columns: int = 2


@dataclass(frozen=True, slots=True)
class TableBlock:
    """A table: ``align`` has one letter (l, r, c) a column; ``strong`` are the rows in bold, by number."""

    kind: ClassVar[str] = "table"
    head: Row
    rows: tuple[Row, ...]
    align: str
    strong: tuple[int, ...] = ()
    dense: bool = False
    wide: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class PictureBlock:
    """A drawing as inline SVG, ``width_mm`` on paper, with what it shows in words."""

    kind: ClassVar[str] = "picture"
    svg: str
    width_mm: float
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Band:
    """The answer: a word with its sign, never told by colour alone, and a sentence or more."""

    kind: ClassVar[str] = "band"
    state: State
    word: str
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Bullets:
    """Short sentences, one a line."""

    kind: ClassVar[str] = "bullets"
    items: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Signatures:
    """Lines to sign on: who signs, and the words for place, date and name."""

    kind: ClassVar[str] = "signatures"
    who: tuple[str, ...]
    place_and_date: str


@dataclass(frozen=True, slots=True)
class PageBreak:
    """What follows begins on a new page."""

    kind: ClassVar[str] = "break"


@dataclass(frozen=True, slots=True)
class Pair:
    """Two groups side by side; ``share`` of the width for the left one."""

    kind: ClassVar[str] = "pair"
    left: tuple[Block, ...]
    right: tuple[Block, ...]
    share: float = 0.5


@dataclass(frozen=True, slots=True)
class Whole:
    """Blocks that stay together on one page."""

    kind: ClassVar[str] = "whole"
    blocks: tuple[Block, ...]


Block = (
    Heading
    | Paragraph
    | FactsBlock
    | TableBlock
    | PictureBlock
    | Band
    | Bullets
    | Signatures
    | PageBreak
    | Pair
    | Whole
)


@dataclass(frozen=True, slots=True)
class Letterhead:
    """Who makes the report: name, lines of address, a logo as bytes with its ending (svg, png, jpg; "" for none)."""

    name: str = ""
    lines: tuple[str, ...] = ()
    logo: bytes = b""
    logo_ending: str = ""


@dataclass(frozen=True, slots=True)
class Document:
    """A whole document; ``simulated`` is the word on every page where a double was in the loop, "" else.

    ``page_of`` has {n} and {m}; ``written_utc`` is the day it was written, which is no part of what it says.
    """

    title: str
    number: str
    language: str
    letterhead: Letterhead
    blocks: tuple[Block, ...]
    page_of: str
    number_word: str
    foot: str
    simulated: str = ""
    simulated_said: str = ""
