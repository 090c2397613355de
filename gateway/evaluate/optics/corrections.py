"""The record of what was corrected: every step by whom and with which coefficients, refused a second time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, get_args

from drivers.message import Message, words
from drivers.types.values import CompensatedFor
from gateway.domain.captures import CorrectionRecord, Corrections
from gateway.errors import ModelError

Step = Literal["air", "expansion", "dead_path", "drift", "cosine", "abbe", "closure"]
GATEWAY, INSTRUMENT = "gateway", "instrument"
_SUMMARISED = ("air", "expansion", "dead_path", "drift")
STEP_NAMES: Mapping[Step, str] = {
    "air": "S-STEP-AIR",
    "expansion": "S-STEP-EXPANSION",
    "dead_path": "S-STEP-DEAD-PATH",
    "drift": "S-STEP-DRIFT",
    "cosine": "S-STEP-COSINE",
    "abbe": "S-STEP-ABBE",
    "closure": "S-STEP-CLOSURE",
}
_BY_INSTRUMENT_ONCE = Message.stored(words("S-CORR-INSTRUMENT"))
"""How records that were stored before there was a chain name the instrument's own step."""


def begin(already: CompensatedFor) -> Corrections:
    """The record of readings as an instrument or file delivers them."""
    by_instrument = Message.of("S-CORR-INSTRUMENT")
    done: dict[CompensatedFor, tuple[Step, ...]] = {
        "nothing": (),
        "air": ("air",),
        "air+material": ("air", "expansion"),
    }
    record = Corrections()
    for step in done[already]:
        record = record_step(record, step, by_instrument, INSTRUMENT)
    return record


def record_step(
    record: Corrections, step: Step, words: Message, by: str = GATEWAY, /, **coefficients: float
) -> Corrections:
    """The record with one more step; raises ModelError (E-EVAL-TWICE) when it stands already."""
    refuse_twice(record, step, words)
    return _with(record, step, words, by, coefficients)


def revert_step(
    record: Corrections, step: Step, words: Message, by: str = GATEWAY, /, **coefficients: float
) -> Corrections:
    """The record with a step of the instrument taken back, so that a better one may follow.

    Raises ModelError (E-EVAL-UNDO) when the step does not stand, or is no step of the instrument's: what this
    program corrected is done again from the readings, never taken back and forth.
    """
    done, owner = describe_step(record, step), _owner(record, step)
    if done is None or owner != INSTRUMENT:
        told = done or Message.of("S-STEP-NONE")
        raise ModelError("E-EVAL-UNDO", "corrections", step=_step_name(step), done=told, asked=words)
    return _with(record, step, words, by, coefficients, undo=True)


def refuse_twice(record: Corrections, step: Step, words: Message) -> None:
    """Raise ModelError (E-EVAL-TWICE) when this step stands already."""
    done = describe_step(record, step)
    if done is not None:
        raise ModelError("E-EVAL-TWICE", "corrections", step=_step_name(step), done=done, asked=words)


def describe_step(record: Corrections, step: Step) -> Message | None:
    """How a step that stands was done; None where it does not."""
    if step in _SUMMARISED:
        done: Message | None = getattr(record, step)
        return done
    last = _latest_step(record, step)
    return None if last is None or last.undone else last.words


def describe_steps(record: Corrections) -> tuple[Message, ...]:
    """What stands, one line a step, for reports and flags; a removed drift is always said."""
    lines: list[tuple[Step, Message | None]] = [(step, describe_step(record, step)) for step in get_args(Step)]
    return tuple(
        Message.of("S-STEP-LINE", step=_step_name(step), said=said) for step, said in lines if said is not None
    )


def _step_name(step: Step) -> Message:
    return Message.of(STEP_NAMES[step])


def _latest_step(record: Corrections, step: Step) -> CorrectionRecord | None:
    return next((item for item in reversed(record.chain) if item.step == step), None)


def _owner(record: Corrections, step: Step) -> str:
    last = _latest_step(record, step)
    if last is not None:
        return last.by
    # Records stored before there was a chain say it in words.
    return INSTRUMENT if describe_step(record, step) == _BY_INSTRUMENT_ONCE else GATEWAY


def _with(
    record: Corrections, step: Step, words: Message, by: str, coefficients: dict[str, float], *, undo: bool = False
) -> Corrections:
    numbers = {name: float(value) for name, value in coefficients.items()}
    item = CorrectionRecord(step=step, by=by, words=words, coefficients=numbers, undone=undo)
    details = {**record.details, **{f"{step}{'.undone' if undo else ''}.{name}": v for name, v in numbers.items()}}
    changed = replace(record, details=details, chain=(*record.chain, item))
    return _with_step(changed, step, None if undo else words)


def _with_step(record: Corrections, step: Step, words: Message | None) -> Corrections:
    if step == "air":
        return replace(record, air=words)
    if step == "expansion":
        return replace(record, expansion=words)
    if step == "dead_path":
        return replace(record, dead_path=words)
    return replace(record, drift=words) if step == "drift" else record
