"""The control's own lists: words of the language, machine and setting data, system variables."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

_TYPES = {"DOUBLE": "REAL", "DWORD": "INT", "UDWORD": "INT", "BYTE": "INT", "UBYTE": "INT", "BOOLEAN": "BOOL"}
_PRINTED = {"Keywords": ("PROC",)}  # what the manuals print and the list lacks
_AXIAL = ("$MA_", "$SA_")  # their axis is one index more than the list counts


@dataclass(frozen=True)
class Datum:
    """A machine datum, setting datum or system variable: language type, number of indices, its number or None."""

    type: str
    indices: int
    number: int | None


@dataclass(frozen=True)
class Dictionary:
    """Data by name (with $), and the words of the language by class."""

    data: Mapping[str, Datum]
    words: Mapping[str, frozenset[str]]

    @functools.cached_property
    def reserved(self) -> frozenset[str]:
        """Every word that the language keeps for itself."""
        return frozenset().union(*self.words.values()) | {name for name in self.data if not name.startswith("$")}

    @functools.cached_property
    def functions(self) -> frozenset[str]:
        """Words that return a value."""
        return self.words["Functions"]

    @functools.cached_property
    def procedures(self) -> frozenset[str]:
        """Words that are called for what they do, the maker's cycles among them."""
        return self.words["Procedures"] | self.words["Cycles"] | self.words["Proc Attributes"]

    @functools.cached_property
    def commands(self) -> frozenset[str]:
        """G commands, with number or with a name."""
        return self.words["Commands"]

    @functools.cached_property
    def addresses(self) -> frozenset[str]:
        """Words that take a value behind an equals sign."""
        return self.words["Address"]

    @functools.cached_property
    def keywords(self) -> frozenset[str]:
        """Words that stand at the head of a statement."""
        return self.words["Keywords"]


@functools.cache
def dictionary() -> Dictionary:
    """Read the package's list, once."""
    raw = json.loads(resources.files(__package__).joinpath("dictionary.json").read_text(encoding="utf-8"))
    data: dict[str, Datum] = {}
    for part in ("machine_data", "setting_data", "variables"):
        data.update({name: _datum(name, entry) for name, entry in raw[part].items()})
    return Dictionary(data, {name: _words(name, listed) for name, listed in raw["words"].items()})


def _datum(name: str, entry: Mapping[str, object]) -> Datum:
    kind = str(entry["type"])
    number = entry.get("number")
    count = int(str(entry["indices"])) + name.startswith(_AXIAL)
    return Datum(_TYPES.get(kind, kind), count, None if number is None else int(str(number)))


def _words(name: str, listed: list[str]) -> frozenset[str]:
    """Headings of the list (Address, Command) stand in mixed case and are no words."""
    return frozenset(word for word in listed if word == word.upper()) | frozenset(_PRINTED.get(name, ()))
