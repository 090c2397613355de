"""Who acts: who is signed in at the service, else who is at the keyboard, as the operating system knows it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

if sys.platform == "win32":

    def os_user() -> str:
        """The name of the user this process belongs to."""
        return os.getlogin()

else:
    import pwd

    def os_user() -> str:
        """The name of the user this process belongs to; ``uid:N`` where the system has no name for him."""
        try:
            return pwd.getpwuid(os.getuid()).pw_name
        except KeyError:
            return f"uid:{os.getuid()}"


_signed_in: ContextVar[str] = ContextVar("signed in", default="")


def signed_in() -> str:
    """Who is signed in at the service for what this task does; "" at a keyboard."""
    return _signed_in.get()


def person() -> str:
    """In whose name this task works; the operating system's user where nobody signed in for it."""
    return _signed_in.get() or os_user()


@contextmanager
def acting(name: str) -> Iterator[None]:
    """What the block does, its tasks among it, is done in this name; "" changes nothing."""
    before = _signed_in.set(name or _signed_in.get())
    try:
        yield
    finally:
        _signed_in.reset(before)
