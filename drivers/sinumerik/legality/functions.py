"""The language's functions: how many values they take, of which kind, and what they return."""

from __future__ import annotations

from typing import NamedTuple

from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.types import UNKNOWN, judge_assignment


class Signature(NamedTuple):
    """Fewest and most values, the type of each ("?" is not judged), the type returned."""

    least: int
    most: int
    takes: tuple[str, ...]
    gives: str


def _one(kind: str, gives: str) -> Signature:
    return Signature(1, 1, (kind,), gives)


_REAL = _one("REAL", "REAL")
_POSITION = _one("REAL", "REAL")

SIGNATURES: dict[str, Signature] = {
    **dict.fromkeys(("SIN", "COS", "TAN", "ASIN", "ACOS", "SQRT", "ABS", "POT", "LN", "EXP", "TRUNC"), _REAL),
    **dict.fromkeys(("ROUND", "ROUNDUP"), _REAL),
    **dict.fromkeys(("AC", "IC", "DC", "ACP", "ACN", "CAC", "CIC", "CDC", "CACP", "CACN"), _POSITION),
    "ATAN2": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "MINVAL": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "MAXVAL": Signature(2, 2, ("REAL", "REAL"), "REAL"),
    "BOUND": Signature(3, 3, ("REAL", "REAL", "REAL"), "REAL"),
    "RTOI": _one("REAL", "INT"),
    "ITOR": _one("INT", "REAL"),
    "NUMBER": _one("STRING", "REAL"),
    "ISNUMBER": _one("STRING", "BOOL"),
    "ISFILE": _one("STRING", "BOOL"),
    "ISVAR": _one("STRING", "BOOL"),
    "GETVARTYP": _one("STRING", "INT"),
    "STRLEN": _one("STRING", "INT"),
    "TOUPPER": _one("STRING", "STRING"),
    "TOLOWER": _one("STRING", "STRING"),
    "INDEX": Signature(2, 2, ("STRING", "CHAR"), "INT"),
    "RINDEX": Signature(2, 2, ("STRING", "CHAR"), "INT"),
    "SUBSTR": Signature(2, 3, ("STRING", "INT", "INT"), "STRING"),
    "AXNAME": _one("STRING", "AXIS"),
    "AXSTRING": _one("AXIS", "STRING"),
    "ISAXIS": _one("INT", "BOOL"),
    "SPI": _one("INT", "AXIS"),
}

PROCEDURES: dict[str, Signature] = {
    "MSG": Signature(0, 2, ("STRING", "INT"), ""),
    "WRITE": Signature(3, 3, (UNKNOWN, "STRING", "STRING"), ""),
    "DELETE": Signature(2, 2, (UNKNOWN, "STRING"), ""),
    "READ": Signature(5, 5, (UNKNOWN, "STRING", "INT", "INT", UNKNOWN), ""),
    "SETAL": Signature(1, 2, ("INT", "STRING"), ""),
    "STOPRE": Signature(0, 0, (), ""),
    "NEWCONF": Signature(0, 0, (), ""),
    "TRAFOOF": Signature(0, 0, (), ""),
}


def judge_values(name: str, signature: Signature, given: list[str]) -> None:
    """Raise Illegal for a wrong number of values, or one that does not become what is taken."""
    if not signature.least <= len(given) <= signature.most:
        least, most = signature.least, signature.most
        wanted = str(least) if least == most else f"{least} to {most}"
        raise Illegal("E-LEGAL-VALUES", name=name, given=len(given), wanted=wanted)
    for taken, kind in zip(signature.takes, given, strict=False):
        judge_assignment(taken, name, kind)
