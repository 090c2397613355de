"""The record of what was corrected: every step once, refused a second time."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from drivers.types import CompensatedFor
from gateway.domain import Corrections
from gateway.errors import ModelError

Step = Literal["air", "expansion", "dead_path", "drift"]
NONE = "none"


def begin(already: CompensatedFor) -> Corrections:
    """The record of readings as an instrument or file delivers them."""
    by_instrument = "by the instrument"
    return Corrections(
        air=NONE if already == "nothing" else by_instrument,
        expansion=by_instrument if already == "air+material" else NONE,
        dead_path=NONE,
        drift=NONE,
    )


def applied(record: Corrections, step: Step, words: str, **coefficients: float) -> Corrections:
    """The record with one more step; raises ModelError (E-EVAL-TWICE) when it was done before."""
    refuse_twice(record, step, words)
    added = {f"{step}.{name}": float(value) for name, value in coefficients.items()}
    changed = replace(record, details={**record.details, **added})
    return _with_step(changed, step, words)


def refuse_twice(record: Corrections, step: Step, words: str) -> None:
    """Raise ModelError (E-EVAL-TWICE) when this step is in the record already."""
    done = str(getattr(record, step))
    if done != NONE:
        raise ModelError("E-EVAL-TWICE", "corrections", step=step.replace("_", " "), done=done, asked=words)


def _with_step(record: Corrections, step: Step, words: str) -> Corrections:
    if step == "air":
        return replace(record, air=words)
    if step == "expansion":
        return replace(record, expansion=words)
    if step == "dead_path":
        return replace(record, dead_path=words)
    return replace(record, drift=words)
