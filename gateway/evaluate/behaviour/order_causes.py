"""What orders of a transmission error come from, by their number: kinds as data, their words in the catalogues."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from drivers.message import ENGLISH, Message, render


class CauseKind(StrEnum):
    """What makes an order: a part of the drive, or its meeting with another part."""

    OUTPUT = "output"
    OUTPUT_TWICE = "output-twice"
    DISC = "disc"
    DISC_OR_CRANKS = "disc-or-cranks"
    RING = "ring"
    PROFILE = "profile"
    CRANKS = "cranks"
    AGAINST_PLANETS = "against-planets"
    INPUT = "input"
    SUN_TEETH = "sun-teeth"
    TOGETHER = "together"


CODES = {
    CauseKind.OUTPUT: "S-ORDER-OUTPUT",
    CauseKind.OUTPUT_TWICE: "S-ORDER-OUTPUT-TWICE",
    CauseKind.DISC: "S-ORDER-DISC",
    CauseKind.DISC_OR_CRANKS: "S-ORDER-DISC-CRANKS",
    CauseKind.RING: "S-ORDER-RING",
    CauseKind.PROFILE: "S-ORDER-PROFILE",
    CauseKind.CRANKS: "S-ORDER-CRANKS",
    CauseKind.AGAINST_PLANETS: "S-ORDER-AGAINST",
    CauseKind.INPUT: "S-ORDER-INPUT",
    CauseKind.SUN_TEETH: "S-ORDER-SUN",
    CauseKind.TOGETHER: "S-ORDER-TOGETHER",
}
FOLDED = "S-ORDER-FOLDED"


@dataclass(frozen=True, slots=True)
class OrderCause:
    """One possible cause: ``waves`` are those round disc (i of zp) and ring (j of zc), 0 where they say nothing.

    ``folded``: the pattern repeats more often than half of the readings a turn, and shows as this lower order.
    """

    kind: CauseKind
    waves: tuple[int, int] = (0, 0)
    folded: bool = False

    @property
    def message(self) -> Message:
        """Its words, of the catalogue, for any language."""
        i, j = self.waves
        told = Message.of(CODES[self.kind], m=i or j, i=i, j=f"{j:+d}")
        return Message.of(FOLDED, cause=told) if self.folded else told

    def as_data(self) -> dict[str, object]:
        """Plain data."""
        return {"kind": str(self.kind), "waves": list(self.waves), "folded": self.folded}


def in_words(causes: Sequence[OrderCause], language: str = ENGLISH) -> str:
    """All causes of an order in a language, the likely one first; "" for none."""
    return "; ".join(render(one.message, language) for one in causes)
