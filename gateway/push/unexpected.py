"""What nobody foresaw in a push becomes an error of ours, so that it leads back to the old table as any failure does.

A bug's TypeError, an OSError, a cancel that one of our own limits or tasks let slip: once a write has been announced
each means the same, "unknown". Only a cancel from outside, and the end of the process itself, pass as they are.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from drivers.errors import TrueflankError
from gateway.errors import Unexpected
from gateway.push.context import PushContext
from gateway.push.records.journal import Journal
from gateway.push.records.replaying import replaying


@contextmanager
def foreseen(where: str) -> Iterator[None]:
    """Run a step of a push. Raises Unexpected (E-PUSH-UNEXPECTED) for whatever is no error of ours."""
    before = _cancels()
    try:
        yield
    except TrueflankError:
        raise
    except asyncio.CancelledError as error:
        if _cancels() > before:
            raise
        raise _unexpected(where, error) from error
    except Exception as error:
        raise _unexpected(where, error) from error


def _unexpected(where: str, error: BaseException) -> Unexpected:
    return Unexpected("E-PUSH-UNEXPECTED", where, kind=type(error).__name__, why=str(error) or "no words")


def _cancels() -> int:
    """How many wish from outside that this task ends."""
    task = asyncio.current_task()
    return task.cancelling() if task is not None else 0


def quiet_in_replay(context: PushContext, kept: Journal) -> PushContext:
    """The context with a voice that does not tell again what was told before this work was taken up again."""
    say = context.say

    def told(code: str, /, **fields: object) -> None:
        if not replaying(kept):
            say(code, **fields)

    return replace(context, say=told)


def unheard(context: PushContext) -> PushContext:
    """The context with a voice that cannot stop a push: a terminal that is gone leaves no table half way."""

    def say(code: str, /, **fields: object) -> None:
        try:
            context.say(code, **fields)
        except Exception:  # noqa: BLE001 - what is told has been noted; who tells it may be gone
            return

    return replace(context, say=say)
