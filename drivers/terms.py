"""The field's words for what a control holds and asks of a person; each driver of a control brings its own.

Programs and records say "axis" and "cross"; what people read says what stands in the control's manual. One process
serves one machine, so one set of terms is spoken in it, as one language is. Above this floor nobody writes such a
word: texts of the catalogue ask for a term by ``{term_NAME}``, all others by `spoken`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

TableKind = Literal["axis", "cross", "reversal"]
PREFIX = "term_"
_SYMBOLS = {"um": "µm", "degC": "°C"}
_GERMAN_UM = re.compile(r"(?<=[\d)}>] )um(?![\w\-=\"`])")
_UNIT = re.compile(r"`[^`]*`|(?<![\w\-./\\'\"`=])(um|degC)(?![\w\-='\"`\\]|\.\w)")


class Coded(str):
    """A term that is a sentence or differs by language: a code of the catalogue."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Terms:
    """What people call the tables of a control, where their memory is set, and how they consent; the plain words here.

    ``own`` and ``cross`` are the kinds of tables, ``own_key`` and ``cross_key`` how they are typed and named
    (X1-cec3), ``reversal`` and ``reversal_key`` the constant reversal of an axis (X1-reversal); ``own_rule``,
    ``cross_rule`` and ``reversal_rule`` say in one sentence which way a stored value acts, ``own_side`` where.
    ``own_memory`` and ``cross_memory`` name the setting that reserves points, ``own_reserve`` and ``cross_reserve``
    in short; ``backlash`` that of the reversal; ``product`` how tables multiply; ``units``, ``senses``,
    ``cross_sum``, ``cross_type`` and ``cross_off`` the settings of what they say; ``words`` where programs shake hands.
    ``start`` and ``restart`` are what a person does. ``older`` maps keys and kinds of records kept by versions that
    wrote the control's own words.
    """

    own: str = "axis table"
    cross: str = "cross table"
    own_key: str = "axis"
    cross_key: str = "cross"
    reversal: str = "reversal value"
    reversal_key: str = "reversal"
    own_rule: str = Coded("S-TERM-OWN-RULE")
    own_side: str = Coded("S-TERM-OWN-SIDE")
    cross_rule: str = Coded("S-TERM-CROSS-RULE")
    reversal_rule: str = Coded("S-TERM-REVERSAL-RULE")
    sign_doubt: str = Coded("S-TERM-SIGN-DOUBT")
    own_memory: str = Coded("S-TERM-OWN-MEMORY")
    cross_memory: str = Coded("S-TERM-CROSS-MEMORY")
    own_reserve: str = "memory"
    cross_reserve: str = "memory"
    backlash: str = "backlash"
    product: str = Coded("S-TERM-PRODUCT")
    axis_name: str = Coded("S-TERM-AXIS-NAME")
    units: str = Coded("S-TERM-UNITS")
    senses: str = Coded("S-TERM-SENSES")
    cross_sum: str = Coded("S-TERM-CROSS-SUM")
    cross_type: str = "the type"
    cross_off: str = Coded("S-TERM-CROSS-OFF")
    words: str = Coded("S-TERM-WORDS")
    start: str = "START"
    restart: str = "restart"
    version: str = "version"
    serial: str = "serial number"
    controls: str = ""
    suffixes: str = ""
    program_suffix: str = ".txt"
    tables_suffix: str = ".txt"
    older: Mapping[str, str] = field(default_factory=dict)

    def kind(self, kind: TableKind) -> str:
        """What people call a table of this kind."""
        return {"axis": self.own, "cross": self.cross, "reversal": self.reversal}[kind]

    def key(self, kind: TableKind) -> str:
        """How a table of this kind is typed."""
        return {"axis": self.own_key, "cross": self.cross_key, "reversal": self.reversal_key}[kind]

    def name(self, kind: TableKind, axis: str, index: int) -> str:
        """A table among all of a machine: "X1" for an axis' own, "X1-cec3" for cross table 3 of it, "X1-reversal"."""
        tail = {"axis": "", "cross": f"-{self.cross_key}{index}", "reversal": f"-{self.reversal_key}"}
        return axis + tail[kind]

    def axis_of(self, name: str) -> str:
        """The axis of a table's name: "X1" of "X1-cec3" and of "X1-reversal"."""
        return name.removesuffix(f"-{self.reversal_key}").partition(f"-{self.cross_key}")[0]

    def is_cross(self, name: str) -> bool:
        """Whether a table's name is that of a cross table."""
        return f"-{self.cross_key}" in name

    def cross_index(self, word: str) -> int | None:
        """The number in "cec3"; None where the word names no cross table."""
        found = re.fullmatch(re.escape(self.cross_key) + r"(\d{1,2})", word)
        return int(found.group(1)) if found else None


_SPOKEN = [Terms()]


def speak(terms: Terms) -> None:
    """From now on this process speaks the terms of this control."""
    _SPOKEN[0] = terms


def spoken() -> Terms:
    """The terms of the control that this process works with; the plain words before any is known."""
    return _SPOKEN[0]


def shown(text: str, language: str = "en") -> str:
    """The text with its units as people write them: um and degC are for keys and programs, people read µm and °C.

    Keys and file names stay (``--x-um``, ``deviation_um``), and so does what stands in quotes or backticks. German has
    a word "um", which is a unit only behind a number.
    """
    if language == "de":
        return _GERMAN_UM.sub("µm", text).replace(" degC", " °C")
    return _UNIT.sub(lambda found: _SYMBOLS[found[1]] if found[1] else found[0], text)


def filled(key: str) -> str | None:
    """The term that a text of the catalogue asks for as ``{term_NAME}``; None for any other field."""
    if not key.startswith(PREFIX):
        return None
    found = getattr(spoken(), key.removeprefix(PREFIX), None)
    return found if isinstance(found, str) else None


def with_current_keys(data: Any) -> Any:
    """JSON data of a kept record with keys and kinds as they are written today; whatever is no such word stays."""
    older = spoken().older
    if isinstance(data, dict):
        return {older.get(key, key): _value(key, value, older) for key, value in data.items()}
    return [with_current_keys(item) for item in data] if isinstance(data, list) else data


def _value(key: str, value: Any, older: Mapping[str, str]) -> Any:
    if isinstance(value, str):
        return older.get(value, value) if older.get(key) == "kind" else value
    return with_current_keys(value)


def spoken_texts() -> dict[str, str]:
    """Every term of the control by the name that a text of the catalogue asks for (``term_NAME``)."""
    found = {name: getattr(spoken(), name) for name in Terms.__slots__}
    return {f"{PREFIX}{name}": text for name, text in found.items() if isinstance(text, str)}
