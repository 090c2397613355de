"""OPC UA status names of this control -> our exceptions: the one place that decides who must act."""

from __future__ import annotations

from typing import Literal

from drivers.errors import DeviceRefused, TransportError, TrueflankError, UnsupportedDevice

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


def refusal(status: str, where: str, stage: Stage, what: str) -> TrueflankError:
    """The exception for a bad status; ``what`` names the variable, method or user concerned."""
    if stage == "login":
        return _at_login(status, where, what)
    if status in _DOWN:
        return TransportError("E-UA-NCK-DOWN", where, retryable=stage == "read", status=status, what=what)
    if status in _LOST:
        return TransportError("E-UA-LOST", where, retryable=stage == "read", status=status, what=what)
    if status in _ABSENT:
        return UnsupportedDevice("E-UA-ABSENT", where, status=status, what=what)
    if status in _RIGHTS:
        return DeviceRefused("E-UA-RIGHTS", where, status=status, what=what)
    if status == "BadNotSupported" and stage == "call":
        return DeviceRefused("E-UA-LEVEL", where, status=status, what=what)
    if status == "BadInvalidState":
        return DeviceRefused("E-UA-BUSY", where, status=status, what=what)
    if status in ("BadNotFound", "BadFileNotFound"):
        return DeviceRefused("E-UA-FILE", where, status=status, what=what)
    return DeviceRefused("E-UA-REFUSED", where, status=status, what=what)


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
