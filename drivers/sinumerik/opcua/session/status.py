"""OPC UA status names of this control -> our exceptions: the one place that decides who must act."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from cryptography.exceptions import InvalidSignature

from drivers.errors import (
    DeviceRefused,
    LocalProtocolError,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
)

Stage = Literal["login", "read", "write", "call"]

_LOGIN = frozenset(
    {"BadUserAccessDenied", "BadIdentityTokenRejected", "BadIdentityTokenInvalid", "BadUserSignatureInvalid"}
)
_TRUST = frozenset({"BadSecurityChecksFailed", "BadSecurityPolicyRejected", "BadSecurityModeRejected", "BadNoMatch"})
_SESSIONS = frozenset({"BadTooManySessions", "BadMaxConnectionsReached", "BadTcpServerTooBusy"})
_DOWN = frozenset(
    {"BadCommunicationError", "BadNotConnected", "BadOutOfService", "BadResourceUnavailable", "BadServerHalted"}
)
_ABSENT = frozenset({"BadAttributeIdInvalid", "BadNodeIdUnknown", "BadNodeIdInvalid", "BadMethodInvalid"})
_RIGHTS = frozenset({"BadUserAccessDenied", "BadRequestNotAllowed", "BadNotWritable"})
_LOST = frozenset(
    {
        "BadSessionIdInvalid",
        "BadSessionClosed",
        "BadSessionNotActivated",
        "BadSecureChannelIdInvalid",
        "BadConnectionClosed",
    }
)


def is_lost(status: str) -> bool:
    """Whether a status means that session or channel are gone and a fresh client is needed."""
    return status in _LOST


def is_down(status: str) -> bool:
    """Whether a status means that the server lives but the NCK behind it does not answer."""
    return status in _DOWN


def is_absent(status: str) -> bool:
    """Whether the server has no such node."""
    return status in _ABSENT


def refusal(status: str, where: str, stage: Stage, what: str) -> TrueflankError:
    """The exception for a bad status; ``what`` names the variable, method or user concerned."""
    if stage == "login":
        return _at_login(status, where, what)
    if status in _DOWN:
        return TransportError("E-UA-NCK-DOWN", where, retryable=stage == "read", status=status, what=what)
    if status in _LOST:
        return TransportError("E-UA-LOST", where, retryable=stage == "read", status=status, what=what)
    if status.startswith(("Good", "Uncertain")):
        return _unsure(status, where, stage, what)
    if status in _ABSENT:
        return UnsupportedDevice("E-UA-ABSENT", where, status=status, what=what)
    if status in _RIGHTS:
        return DeviceRefused("E-UA-RIGHTS", where, status=status, what=what)
    if status == "BadNotSupported" and stage == "call":
        return DeviceRefused("E-UA-LEVEL", where, status=status, what=what)
    if status == "BadTypeMismatch":
        return DeviceRefused("E-UA-TYPE", where, status=status, what=what)
    if status == "BadInvalidState":
        return DeviceRefused("E-UA-BUSY", where, status=status, what=what)
    if status in ("BadNotFound", "BadFileNotFound"):
        return DeviceRefused("E-UA-FILE", where, status=status, what=what)
    return DeviceRefused("E-UA-REFUSED", where, status=status, what=what)


def _unsure(status: str, where: str, stage: Stage, what: str) -> TrueflankError:
    """Neither good nor bad: a value that is not live, or a write or call of which nobody knows the end."""
    if stage == "read":
        return TransportError("E-UA-STALE", where, retryable=True, what=what, why=status)
    return TransportError("E-UA-UNCONFIRMED", where, status=status, what=what)


def check_numbers(values: Sequence[tuple[str, object]], where: str) -> None:
    """Refuse what is no number before it is sent. Raises LocalProtocolError (E-UA-NUMBER)."""
    for path, value in values:
        if isinstance(value, float) and not math.isfinite(value):
            raise LocalProtocolError("E-UA-NUMBER", where, what=path, value=value)


def check_written(paths: Sequence[str], statuses: Sequence[str], where: str) -> None:
    """Take nothing but "good" for written: neither "completes asynchronously" nor "uncertain" is done.

    Raises the first refusal when nothing was written, DeviceRefused (E-UA-PARTIAL) when a part was.
    """
    bad = [(path, status) for path, status in zip(paths, statuses, strict=True) if status != "Good"]
    if len(bad) == len(paths):
        raise refusal(bad[0][1], where, "write", bad[0][0])
    if bad:
        listed = "; ".join(f"{path} {status}" for path, status in bad)
        raise DeviceRefused("E-UA-PARTIAL", where, written=len(paths) - len(bad), refused=listed)


def foreign(error: Exception, stage: Stage, where: str, url: str) -> TrueflankError:
    """The exception for what the library, the system or the wire raised instead of a status."""
    if isinstance(error, InvalidSignature):
        return DeviceRefused("E-UA-TRUST-US", where, status="invalid signature")
    if isinstance(error, AssertionError):  # so the library meets the refusal of a channel; the status is lost
        if stage == "login":
            return DeviceRefused("E-UA-TRUST-US", where, status="secure channel refused")
        return RemoteProtocolError("E-UA-NO-OFFER", where, url=url)
    if isinstance(error, OSError | TimeoutError):
        why = str(error) or type(error).__name__
        return TransportError("E-UA-CONNECT", where, retryable=stage == "read", url=url, why=why)
    return RemoteProtocolError("E-UA-PROTOCOL", where, why=f"{type(error).__name__}: {error}")


def _at_login(status: str, where: str, what: str) -> TrueflankError:
    if status in _LOGIN:
        return DeviceRefused("E-UA-LOGIN", where, status=status, user=what)
    if status in _TRUST or status.startswith("BadCertificate"):
        return DeviceRefused("E-UA-TRUST-US", where, status=status)
    if status in _SESSIONS:
        return DeviceRefused("E-UA-SESSIONS", where, status=status)
    if status in _DOWN or status in _LOST:
        return TransportError("E-UA-LOST", where, retryable=True, status=status, what="login")
    return DeviceRefused("E-UA-REFUSED", where, status=status, what="login")
