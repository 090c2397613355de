"""Three answers and their rule: a change is above or below its limit only by four standard uncertainties.

The limit counts at every place on its own: still valid where every place is clearly within, to be measured again where
one is clearly beyond, cannot tell else. With a scatter known from few readings four standard uncertainties become the
Student factor of the same rarity (6e-5 on both sides together).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import scipy

from drivers.message import Message, fixed
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray

SIGMAS = 4.0
RARE = 6.334e-5  # of a normal distribution beyond four standard deviations, both sides
Answer = Literal["still valid", "re-measure this axis", "cannot tell"]


@dataclass(frozen=True, slots=True)
class Change:
    """One way a curve has changed: offset, slope, harmonic 2, ...; ``U`` (k = 2) and ``size`` in ``unit``.

    ``named`` is what people call it.
    """

    kind: str
    size: float
    U: float
    unit: str
    named: Message | None = None

    @property
    def sure(self) -> bool:
        """Whether it is there at all."""
        return abs(self.size) > 2.0 * self.U


@dataclass(frozen=True, slots=True)
class GuardVerdict:
    """The answer with its reasons: largest change and where, what was allowed, how the curve changed, in words.

    ``margin`` is by how much a change must clear the limit at that place. All in ``unit``.
    """

    answer: Answer
    largest: float
    at: float
    limit: float
    margin: float
    unit: DeviationUnit
    changes: tuple[Change, ...] = ()
    said: tuple[Message, ...] = field(default_factory=tuple)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        changes = [{"kind": c.kind, "size": c.size, "U": c.U, "unit": c.unit, "sure": c.sure} for c in self.changes]
        names = ("answer", "largest", "at", "limit", "margin", "unit")
        return {name: getattr(self, name) for name in names} | {"changes": changes, "said": list(map(str, self.said))}


def margin_factor(freedom: float) -> float:
    """Four for a known scatter, more for one estimated with few degrees of freedom."""
    if not np.isfinite(freedom):
        return SIGMAS
    return max(SIGMAS, float(scipy.special.stdtrit(max(freedom, 1.0), 1.0 - RARE / 2.0)))


def judged(change: FloatArray, margin: FloatArray, limit: float) -> Answer:
    """The answer from changes (m,) and what they must clear the limit by (m,)."""
    size = np.abs(change)
    if np.any(size - margin > limit):
        return "re-measure this axis"
    return "still valid" if bool(np.all(size + margin <= limit)) else "cannot tell"


def unknown(limit: float, unit: DeviationUnit, code: str, **fields: object) -> GuardVerdict:
    """Cannot tell, and why."""
    nan = float("nan")
    return GuardVerdict(
        answer="cannot tell",
        largest=nan,
        at=nan,
        limit=limit,
        margin=nan,
        unit=unit,
        changes=(),
        said=(Message(code, fields),),
    )


def told(changes: tuple[Change, ...]) -> tuple[Message, ...]:
    """The changes that are sure, as people read them."""
    return tuple(
        Message.of("S-GUARD-CHANGE", kind=c.named or c.kind, size=fixed(c.size, signed=True), U=fixed(c.U), unit=c.unit)
        for c in changes
        if c.sure
    )
