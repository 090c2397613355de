"""The second factor: codes of six digits that an authenticator makes of a shared secret and the time (RFC 6238)."""

from __future__ import annotations

import base64
import secrets
from datetime import datetime
from urllib.parse import quote

from cryptography.hazmat.primitives.hashes import SHA1
from cryptography.hazmat.primitives.twofactor import InvalidToken
from cryptography.hazmat.primitives.twofactor.totp import TOTP

STEP_S, DIGITS, DRIFT = 30, 6, 1
"""A code holds for a step; the authenticator's clock may be one step early or late."""
_SECRET_BYTES = 20


def new_factor() -> str:
    """A new shared secret, base32 as authenticators take it."""
    return base64.b32encode(secrets.token_bytes(_SECRET_BYTES)).decode("ascii")


def is_factor(secret: str) -> bool:
    """Whether a text is such a secret."""
    try:
        return len(base64.b32decode(secret)) >= _SECRET_BYTES
    except ValueError:
        return False


def factor_uri(secret: str, name: str, issuer: str = "trueflank") -> str:
    """What an authenticator reads from a picture of it."""
    return f"otpauth://totp/{quote(issuer)}:{quote(name)}?secret={secret}&issuer={quote(issuer)}"


def code_at(secret: str, utc: datetime) -> str:
    """The code of a moment."""
    return _made(secret).generate(int(utc.timestamp())).decode("ascii")


def step_of(secret: str, code: str, utc: datetime, after: int = 0) -> int:
    """The step, later than ``after``, whose code this is about a moment; 0 where it is none's.

    A step that was taken once is given as ``after`` the next time: then nobody uses a code that was overlooked.
    """
    now, given = int(utc.timestamp()) // STEP_S, code.strip()
    if not (given.isascii() and given.isdigit() and len(given) == DIGITS):
        return 0
    for step in range(now - DRIFT, now + DRIFT + 1):
        if step > after and _is_code(secret, given, step):
            return step
    return 0


def _is_code(secret: str, code: str, step: int) -> bool:
    try:
        _made(secret).verify(code.encode("ascii"), step * STEP_S)
    except InvalidToken:
        return False
    return True


def _made(secret: str) -> TOTP:
    return TOTP(base64.b32decode(secret), DIGITS, SHA1(), STEP_S)  # noqa: S303 - what authenticators know
