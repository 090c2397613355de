"""What a reader or a check is not sure of, as a code with fields: it travels with the readings to every figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.errors import words
from drivers.message import Message


@dataclass(frozen=True, slots=True)
class Doubt:
    """One doubt about readings, by the code of its text; the text is written only where a person reads it.

    ``where`` names the file, line or target. A ``blocking`` doubt is so large that neither a verdict nor a table comes
    of the readings until a person has settled it; any other is shown with the figures. The text's fields are
    ``numbers`` and ``names``, which have precedence. ``settled`` is the reason of a person who accepted a blocking
    one: it blocks no more and stays in the record.
    """

    code: str
    where: str = ""
    blocking: bool = False
    names: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    settled: str = ""

    @property
    def message(self) -> Message:
        """What is doubtful, as a record contains it."""
        return Message(self.code, {**self.numbers, **self.names})

    @property
    def text(self) -> str:
        """What is doubtful, in English."""
        return words(self.code, "what", **{**self.numbers, **self.names})

    @property
    def remedy(self) -> str:
        """What to do about it, in English."""
        return words(self.code, "do", **{**self.numbers, **self.names})
