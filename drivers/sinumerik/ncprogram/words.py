"""The block of R parameters through which a program and the gateway speak: places, phases, file names."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

COUNT = 20


class Word(IntEnum):
    """Place of each word, counted from the site's first R parameter.

    A push uses two of a measuring run's words for its tables, bit by bit from the first: which are as sent (the
    program's word), which are released (the gateway's). A measuring run uses a push's words for a further stop: where
    the axis goes first, from which side it comes (0: no further stop), where it then stands.
    """

    COUNTER = 0
    REPETITION = 1
    LABEL = 2
    APPROACH = 3
    TARGET = 4
    ECHO = 5
    ABORT = 6
    TRANSACTION = 7
    MISMATCHES = 8
    RELEASE = 9
    PHASE = 10
    ENCODER_COMPENSATION = 11
    CROSS_COMPENSATION = 12
    TABLE = 13
    AXIS = 14
    POINTS = 15
    MARKER = 16
    MARKER_STATE = 17
    HEAD_HIGH = 18
    HEAD_LOW = 19
    GOOD = 2
    PASSED = 5
    LEAD = 13
    SIDE = 14
    NEXT = 15


# The marker outlives programs and sessions; odd numbers, so that no other use of these R parameters reads as one.
# The head of the audit log stands in two halves of 32 bits, each exact in an R parameter.
MARKED = (Word.MARKER, Word.MARKER_STATE, Word.HEAD_HIGH, Word.HEAD_LOW)
HALF = 1 << 32
MARKER_STATES: dict[int, Literal["none", "in-progress", "committed", "held"]] = {
    8401: "in-progress",
    8402: "committed",
    8403: "held",
    8404: "none",
}

FAMILY = {"axis": 1000, "cross": 2000, "reversal": 3000}
"""What the word of the table counts from, by its kind."""


class Phase(IntEnum):
    """How far a program is.

    1 to 5, 9 and 18 are a push; 1 and 6 to 8 a measuring run; 1, 7, 8, 13 and 14 a test part; 8, 15 and 16 a
    disable-only order. 17 ends any that moves: an axis had left its safe place, before the first move.
    Of a push 8, 11 and 18 changed nothing; nor did 14.
    """

    NONE = 0
    BACKING_UP = 1
    DISABLED = 2
    WRITTEN = 3
    WAITING = 4
    ENABLED = 5
    MEASURING = 6
    FINISHED = 7
    LEFT = 8
    ENDED_DISABLED = 9
    FILE_FAILED = 11
    WOULD_WAKE = 12
    GRINDING = 13
    SETUP_REFUSED = 14
    SWITCHED_OFF = 15
    STILL_ON = 16
    AWAY = 17
    SAVED = 18


class SetupWord(IntEnum):
    """Place of each set-up value, counted from the site's first R parameter of them: mm, deg, mm."""

    X = 0
    C = 1
    DRESSING = 2


@dataclass(frozen=True, slots=True)
class Words:
    """The R parameters of one site: ``first`` and the `COUNT` - 1 after it; ``setup`` and the two after it."""

    first: int = 80
    setup: int = 77

    def number(self, word: Word) -> int:
        """R parameter number of a word."""
        return self.first + int(word)

    def name(self, word: Word) -> str:
        """The word as a program writes it: R80."""
        return f"R{self.number(word)}"

    def setup_number(self, word: SetupWord) -> int:
        """R parameter number of a set-up value."""
        return self.setup + int(word)

    def holds(self, number: int) -> bool:
        """Whether an R parameter is one of these."""
        return 0 <= number - self.first < COUNT or 0 <= number - self.setup < len(SetupWord)


def program_path(purpose: str, axis: str) -> str:
    """Name of a main program of ours in the control: purposes MEAS, PUSH, LOAD, ENAB, OFF, GRIND."""
    return f"/_N_MPF_DIR/_N_TF{purpose}_{axis}_MPF"


def file_path(purpose: str, axis: str) -> str:
    """Name of a file that a program of ours writes: purposes LIVE, BACK (before a push), READ (after it)."""
    return f"/_N_SPF_DIR/_N_TF{purpose}_{axis}_SPF"
