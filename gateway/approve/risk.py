"""The risk that one person alone takes on a connection that is not protected: typed for one command, word for word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

UNPROTECTED = "unprotected"
"""The word."""
_typed: ContextVar[str] = ContextVar("the risk that was typed", default="")


@contextmanager
def risking(typed: str) -> Iterator[None]:
    """In the block ``typed`` is what the person at work wrote of the risk; "": nothing."""
    before = _typed.set(typed)
    try:
        yield
    finally:
        _typed.reset(before)


def risk_taken() -> bool:
    """Whether the person at work has typed the risk."""
    return _typed.get().strip() == UNPROTECTED
