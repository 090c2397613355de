"""What each code of progress is to a person: to be heard, to be done, a beginning, a result, or a detail; pure."""

from __future__ import annotations

from enum import Enum

from drivers.errors import text_of


class Audience(Enum):
    """From what must never be left out to what the log alone needs."""

    LOUD = "loud"
    ASK = "ask"
    RESULT = "result"
    STEP = "step"
    MOVE = "move"
    COUNT = "count"
    DETAIL = "detail"


LOUD = (
    "P-AUDIT",
    "P-CAP-BEAM",
    "P-CAP-OVERDUE",
    "P-CLOSE-GOING-BACK",
    "P-CLOSE-NOTHING",
    "P-CLOSE-STAYS",
    "P-LEFT",
    "P-PART-LOOK",
    "P-PART-OTHER-TABLES",
    "P-PUSH-DISABLE-MOVES",
    "P-PUSH-HELD",
    "P-PUSH-HELD-ON",
    "P-PUSH-REST-STAYS",
    "P-PUSH-RESTORE",
    "P-PUSH-WITHOUT",
    "P-PUSH-WITHOUT-FLANK",
    "P-SELF-TEST-FAILED",
    "P-STOPPING",
    "P-STOPPING-STILL",
    "P-TABLE-ALARM",
    "P-UNPROTECTED",
    "P-VERIFY-UNPROVED",
    "P-WATCH-FAILED",
    "P-WATCH-FOLDER",
    "P-WATCH-LINK",
)
ASK = (
    "P-GRIND-BEGUN",
    "P-GRIND-DONE",
    "P-GRIND-PREPARED",
    "P-INSPECT-CLAMP",
    "P-JOG-SETUP",
    "P-JOG-STOP",
    "P-MOUNT",
    "P-PUSH-ACTIVATE",
    "P-PUSH-NEXT-START",
    "P-PUSH-DISABLE-START",
    "P-PUSH-DISABLE",
    "P-PUSH-EFFECT",
    "P-PUSH-JOG",
    "P-PUSH-LOAD",
    "P-PUSH-RELEASE",
    "P-PUSH-RESET",
    "P-PUSH-RESTART",
    "P-PUSH-SIGN",
    "P-PUSH-SIGN-AGAIN",
    "P-PUSH-SIGN-STOPS",
    "P-PUSH-START",
    "P-PUSH-TRIALS",
    "P-SELF-TEST",
    "P-START",
    "P-START-SETUP",
)
STEP = (
    "P-ACTING",
    "P-MEASURE",
    "P-MORE-TARGETS",
    "P-OPEN",
    "P-PART",
    "P-RUN",
    "P-SETUP",
    "P-SETUP-ANEW",
    "P-SETUP-PLAN",
    "P-SIGN",
)
MOVE = (
    "P-MOVE-BETWEEN",
    "P-MOVE-BRING",
    "P-MOVE-FURTHER",
    "P-MOVE-NOTHING",
    "P-MOVE-OFF-STILL",
    "P-MOVE-ON-STILL",
    "P-MOVE-OTHERS",
    "P-MOVE-STANDS",
    "P-MOVE-SWITCH-OFF",
    "P-MOVE-SWITCH-ON",
    "P-MOVE-SWITCHED",
    "P-MOVE-TO",
    "P-MOVE-TURNS",
)
COUNT = ("P-GRIND-SPACE", "P-INSPECT", "P-STOP")
DETAIL = (
    "P-CAP-DYNAMIC",
    "P-CAP-OUT-OF-LINE",
    "P-CAP-RETAKE",
    "P-CAP-UNSETTLED",
    "P-GRIND-SETUP",
    "P-GRIND-TABLES",
    "P-HIDDEN",
    "P-REVERSAL-VARIES",
    "P-SELF-TEST-PASSED",
    "P-PART-DONE",
    "P-PUSH-PROOF-OFF",
    "P-PUSH-REFUSED",
    "P-PUSH-RELEASED",
    "P-PUSH-STEP",
    "P-SIGN-PROVED",
    "P-STOPPED-PUSH",
    "P-TABLE-STATE",
    "P-WATCH-SAME",
)
KINDS = {
    **dict.fromkeys(LOUD, Audience.LOUD),
    **dict.fromkeys(ASK, Audience.ASK),
    **dict.fromkeys(STEP, Audience.STEP),
    **dict.fromkeys(MOVE, Audience.MOVE),
    **dict.fromkeys(COUNT, Audience.COUNT),
    **dict.fromkeys(DETAIL, Audience.DETAIL),
}


def kind_of(code: str) -> Audience:
    """What a code is; one of a driver that asks for the start is an `ASK`, whatever else nobody named a result."""
    asks = "{term_start}" in (text_of(code) or {}).get("what", "")
    return KINDS.get(code, Audience.ASK if asks else Audience.RESULT)
