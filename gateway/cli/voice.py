"""How much this process says to people: what must be heard, the results, or every step."""

from __future__ import annotations

from enum import IntEnum


class Voice(IntEnum):
    """From least to most."""

    QUIET = 0
    PLAIN = 1
    VERBOSE = 2


_chosen = {"voice": Voice.PLAIN}


def now() -> Voice:
    """What was chosen on the command line."""
    return _chosen["voice"]


def use(chosen: Voice) -> None:
    """Speak so from here on; every command begins with `Voice.PLAIN`."""
    _chosen["voice"] = chosen


def quiet(given: bool) -> bool:
    """-q was given, or not."""
    if given:
        use(Voice.QUIET)
    return given


def verbose(given: bool) -> bool:
    """-v was given, or not."""
    if given:
        use(Voice.VERBOSE)
    return given
