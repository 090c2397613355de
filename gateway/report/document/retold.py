"""A record's finished English sentence in the document's language, as `gateway/web/page/retold.js` tells it to people.

The text of the catalogue that it was made of is found again, with what was filled in. What is found nowhere stays.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

from drivers.errors import catalogue
from drivers.terms import shown

RECORDED_IN = "en"
LEAST_LETTERS = 6
_FIELD = re.compile(r"\{(\w+)(?:![a-z])?(?::[^}]*)?\}")
_BOUNDARY = re.compile(r"[.;:!?] +|, |\n| -> | → |[(“\"]")
# A text that goes on another one begins behind what joins them: there a sentence is looked at again.
_JOINT = re.compile(r"^[;,；，] ?")
_BETWEEN = re.compile(r"(?:->|[^\w<`-])*")
# "um" is also a German word: there it is a unit only behind a number.
_GERMAN_UM = re.compile(r"(?<=[\d)}] )um(?![\w\-=\"`])")


@dataclass(frozen=True, slots=True)
class _Pattern:
    """One English text: its longest piece in small letters, what matches a sentence of it, its fields, its text."""

    holds: str
    test: re.Pattern[str]
    names: tuple[str, ...]
    weight: int
    own: str

    def told(self, found: re.Match[str], language: str) -> str:
        """The text in the language with what the sentence was filled with."""
        filled = dict(zip(self.names, found.groups(), strict=True))
        return _FIELD.sub(lambda field: retold(filled.get(field[1], field[0]), language), self.own)


def retold(text: str, language: str) -> str:
    """A sentence as people read it, units and all, in another language, as far as the catalogue knows its parts."""
    if language == RECORDED_IN:
        return text
    made, at, small = "", 0, text.lower()
    while at < len(text):
        found = _found(text, small, at, language)
        if found is not None:
            one, match = found
            own = one.told(match, language)
            made += own[:1].upper() + own[1:] if text[at].isupper() else own
            at = match.end()
        behind = _BETWEEN.match(text, at) if found is not None and not text[at : at + 1].isalnum() else None
        end = behind.end() if behind is not None else _boundary(text, at)
        made, at = made + text[at:end], end
    return made


def _found(text: str, small: str, at: int, language: str) -> tuple[_Pattern, re.Match[str]] | None:
    tried = ((one, one.test.match(text, at)) for one in _patterns(language) if one.holds in small)
    return next(((one, match) for one, match in tried if match is not None), None)


def _boundary(text: str, at: int) -> int:
    found = _BOUNDARY.search(text, at)
    return found.end() if found is not None else len(text)


@functools.cache
def _patterns(language: str) -> tuple[_Pattern, ...]:
    """Every text that the language has, those with the most words of their own first."""
    english, own = catalogue(), catalogue(language)
    pairs = ((english[code][part], text) for code, parts in own.items() for part, text in parts.items())
    bare = ((shown(said), _units(text, language)) for said, text in pairs if said)
    made = (_pattern(_JOINT.sub("", said), _JOINT.sub("", text)) for said, text in bare)
    return tuple(sorted((one for one in made if one.weight >= LEAST_LETTERS), key=lambda one: -one.weight))


def _pattern(english: str, own: str) -> _Pattern:
    pieces = _FIELD.split(english)
    literal, names = pieces[::2], tuple(pieces[1::2])
    ends = r"(?=[.;] |\.?$| ->)" if names and not literal[-1] else r"(?=[.,;:)]|\s|$)"
    # What a text begins with is no sentence of its own: that one is told by itself.
    first = r"((?:(?![.!?] ).){0,600}?)" if not literal[0] else r"(.{0,600}?)"
    source = "(.{0,600}?)".join(map(re.escape, literal)).replace("(.{0,600}?)", first, 1)
    test = re.compile(source + ends, re.IGNORECASE | re.DOTALL)
    weight = sum(letter.isalpha() for piece in literal for letter in piece)
    return _Pattern(max(literal, key=len).lower(), test, names, weight, own)


def _units(text: str, language: str) -> str:
    return _GERMAN_UM.sub("µm", text).replace(" degC", " °C") if language == "de" else shown(text)
