"""Progress on its way to people: a code of the catalogue with fields, never a sentence."""

from __future__ import annotations

from typing import Protocol


class Say(Protocol):
    """Tells people how far a run is, e.g. say("P-STOP", axis="X1", program="TFMEASX", done=3, total=210)."""

    def __call__(self, code: str, /, **fields: object) -> None:
        """Tell; returns at once and never raises."""
        ...


def silence(_code: str, /, **_fields: object) -> None:
    """A `Say` that tells nobody."""
