"""The picture of the command at work: what it does, what a person is asked for and what will move then; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drivers.errors import words
from drivers.message import Message
from gateway.audience import Audience, kind_of
from gateway.daemon.hub import plain_fields
from gateway.events import DisableMoves, StopDone, received
from gateway.views import JobView, RunView

MOST_MOVES = 40


def fresh(job: JobView) -> RunView:
    """The picture of a command that has not said anything yet."""
    return RunView(
        run_id="",
        stage="",
        axis="",
        done=0,
        total=0,
        words=None,
        started_utc=job.started_utc,
        kind=job.kind,
        who=job.who,
    )


def told(run: RunView, code: str, fields: Mapping[str, object]) -> RunView:
    """The picture of a run after one more word of it; fields it does not name stay as they were."""
    said = replace(
        run,
        words=Message(code, fields),
        axis=str(fields.get("axis", run.axis)),
        ask=_asked(run, code, fields),
        moves=_moves(run, code, fields),
    )
    event = received(code, fields)
    done, total = (_count(event.done), _count(event.total)) if isinstance(event, StopDone) else (0, 0)
    return replace(said, stage=str(fields.get("program", run.stage)), done=done, total=total)


def _asked(run: RunView, code: str, fields: Mapping[str, object]) -> Mapping[str, object] | None:
    """What a person must do now: details leave it standing, whatever else is said means that it was done."""
    kind = kind_of(code)
    if kind is Audience.ASK:
        return _as_said(code, fields)
    return run.ask if kind is Audience.DETAIL else None


def _moves(run: RunView, code: str, fields: Mapping[str, object]) -> tuple[Mapping[str, object], ...]:
    """What will move when a person does what is asked; what is said after an ask belongs to the next one."""
    kind = kind_of(code)
    if kind is Audience.MOVE or isinstance(received(code, fields), DisableMoves):
        return (*(() if run.ask else run.moves), _as_said(code, fields))[-MOST_MOVES:]
    return run.moves if kind in (Audience.ASK, Audience.DETAIL) else ()


def _as_said(code: str, fields: Mapping[str, object]) -> Mapping[str, object]:
    event = received(code, fields)
    told = {"code": code, "fields": plain_fields(fields), "words": words(code, **fields)}
    return {**told, "event": type(event).__name__ if event else ""}


def _count(value: object) -> int:
    return value if isinstance(value, int) else 0
