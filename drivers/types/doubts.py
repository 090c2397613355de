"""What a reader or a check is not sure of, as a code with fields: it travels with the readings to every figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.errors import words


@dataclass(frozen=True, slots=True)
class Doubt:
    """One doubt about readings, by the code of its text; the text is written only where a person reads it.

    ``where`` names the file, line or target. A ``blocking`` doubt is so large that neither a verdict nor a table comes
    of the readings until a person has settled it; any other is shown with the figures. The fields of the text are
    ``names`` and ``numbers``.
    """

    code: str
    where: str = ""
    blocking: bool = False
    names: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """What is doubtful, in English."""
        return words(self.code, "what", **self.names, **self.numbers)

    @property
    def remedy(self) -> str:
        """What to do about it, in English."""
        return words(self.code, "do", **self.names, **self.numbers)
