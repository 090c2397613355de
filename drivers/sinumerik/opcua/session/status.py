"""Status codes of OPC UA: sorted into families, then mapped to our exceptions, which say who must act.

Families are by what a person can do about a status. Names as in OPC 10000-6, annex A.2. The severity bits alone sort
what is neither good nor bad. A name in no family is a maker's own code: "other", which is refused and, after an
activation, waited through like any other.
"""

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
from drivers.message import Message

# The status codes of the OPC UA standard, sorted into families by what a person can do about them.
#
# Names as in OPC 10000-6, annex A.2. The severity bits alone sort what is neither good nor bad. A name that is in no
# family is a maker's own code: "other", which is refused and, after an activation, waited through like any other.

Family = Literal[
    "good",
    "unsure",
    "down",
    "lost",
    "late",
    "rights",
    "login",
    "absent",
    "busy",
    "clock",
    "trust",
    "limits",
    "licence",
    "type",
    "argument",
    "file",
    "protocol",
    "fault",
    "service",
    "other",
]

# down: the server lives, the source behind it gives no value (yet). lost: session or channel are gone.
# late: nobody knows whether it was or will be done. service: parts of the standard that nothing here asks for.
_SORTED: dict[Family, str] = {
    "down": (
        "BadCommunicationError BadNoCommunication BadNotConnected BadOutOfService BadDeviceFailure BadSensorFailure "
        "BadWaitingForInitialData BadServerHalted BadShutdown BadResourceUnavailable BadNoData BadDataLost "
        "BadDataUnavailable BadNoDataAvailable BadNoValue BadDominantValueChanged BadDependentValueChanged"
    ),
    "lost": (
        "BadSessionIdInvalid BadSessionClosed BadSessionNotActivated BadSecureChannelIdInvalid BadSecureChannelClosed "
        "BadSecureChannelTokenUnknown BadTcpSecureChannelUnknown BadConnectionClosed BadConnectionRejected "
        "BadDisconnect BadServerNotConnected BadRequestInterrupted BadSequenceNumberInvalid"
    ),
    "late": (
        "BadTimeout BadRequestTimeout BadWaitingForResponse BadRequestNotComplete BadOperationAbandoned "
        "BadRequestCancelledByClient BadRequestCancelledByRequest"
    ),
    "rights": (
        "BadUserAccessDenied BadRequestNotAllowed BadNotWritable BadNotReadable BadNotExecutable BadNoDeleteRights "
        "BadSecurityModeInsufficient"
    ),
    "login": ("BadIdentityTokenInvalid BadIdentityTokenRejected BadUserSignatureInvalid BadIdentityChangeNotSupported"),
    "absent": (
        "BadAttributeIdInvalid BadNodeIdUnknown BadNodeIdInvalid BadMethodInvalid BadNotSupported BadNotImplemented "
        "BadServiceUnsupported BadIndexRangeInvalid BadIndexRangeNoData BadObjectDeleted BadNodeNotInView "
        "BadReferenceTypeIdInvalid BadTypeDefinitionInvalid BadNotTypeDefinition BadDataTypeIdUnknown "
        "BadLocaleNotSupported"
    ),
    "busy": (
        "BadInvalidState BadTcpServerTooBusy BadServerTooBusy BadWouldBlock BadExpectedStreamToBlock BadLocked "
        "BadRequiresLock BadTransactionPending BadTransactionFailed BadStateNotActive BadRefreshInProgress"
    ),
    "clock": "BadInvalidTimestamp BadCertificateTimeInvalid BadCertificateIssuerTimeInvalid",
    "trust": (
        "BadSecurityChecksFailed BadSecurityModeRejected BadSecurityPolicyRejected BadCertificateInvalid "
        "BadCertificateHostNameInvalid BadCertificateUriInvalid BadCertificateUseNotAllowed "
        "BadCertificateIssuerUseNotAllowed BadCertificateUntrusted BadCertificateRevocationUnknown "
        "BadCertificateIssuerRevocationUnknown BadCertificateRevoked BadCertificateIssuerRevoked "
        "BadCertificateChainIncomplete BadCertificatePolicyCheckFailed BadNonceInvalid "
        "BadApplicationSignatureInvalid BadNoValidCertificates BadServerUriInvalid BadRequestTypeInvalid "
        "BadTicketRequired BadTicketInvalid"
    ),
    "limits": (
        "BadTooManySessions BadMaxConnectionsReached BadTooManyOperations BadTooManySubscriptions "
        "BadTooManyPublishRequests BadTooManyMonitoredItems BadTooManyMatches BadOutOfMemory BadTcpNotEnoughResources "
        "BadRequestTooLarge BadResponseTooLarge BadTcpMessageTooLarge BadEncodingLimitsExceeded "
        "BadNoContinuationPoints BadQueryTooComplex"
    ),
    "licence": "BadLicenseExpired BadLicenseLimitsExceeded BadLicenseNotAvailable",
    "type": "BadTypeMismatch BadDataEncodingInvalid BadDataEncodingUnsupported",
    "argument": (
        "BadInvalidArgument BadArgumentsMissing BadTooManyArguments BadOutOfRange BadNumericOverflow BadSyntaxError "
        "BadStructureMissing BadWriteNotSupported BadIndexRangeDataMismatch BadNothingToDo BadMaxAgeInvalid "
        "BadTimestampsToReturnInvalid BadInvalidTimestampArgument BadBrowseNameInvalid BadBrowseNameDuplicated "
        "BadBrowseDirectionInvalid BadNodeIdExists BadNodeIdRejected BadNodeClassInvalid BadNodeAttributesInvalid "
        "BadParentNodeIdInvalid BadSourceNodeIdInvalid BadTargetNodeIdInvalid BadReferenceNotAllowed "
        "BadDuplicateReferenceNotAllowed BadInvalidSelfReference BadReferenceLocalOnly BadAlreadyExists "
        "BadEntryExists BadNoMatch BadEdited_OutOfRange BadInitialValue_OutOfRange "
        "BadOutOfRange_DominantValueChanged BadEdited_OutOfRange_DominantValueChanged "
        "BadOutOfRange_DominantValueChanged_DependentValueChanged "
        "BadEdited_OutOfRange_DominantValueChanged_DependentValueChanged"
    ),
    "file": "BadNotFound BadNoEntryExists BadEndOfStream BadSemaphoreFileMissing",
    "protocol": (
        "BadEncodingError BadDecodingError BadUnknownResponse BadRequestHeaderInvalid BadTcpMessageTypeInvalid "
        "BadTcpEndpointUrlInvalid BadProtocolVersionUnsupported BadServerNameMissing BadDiscoveryUrlMissing "
        "BadServerIndexInvalid"
    ),
    "fault": "Bad BadUnexpectedError BadInternalError BadTcpInternalError BadConfigurationError",
    "service": (
        "BadSubscriptionIdInvalid BadNoSubscription BadSequenceNumberUnknown BadMessageNotAvailable "
        "BadInsufficientClientProfile BadMonitoringModeInvalid BadMonitoredItemIdInvalid BadMonitoredItemFilterInvalid "
        "BadMonitoredItemFilterUnsupported BadFilterNotAllowed BadEventFilterInvalid BadContentFilterInvalid "
        "BadFilterOperandInvalid BadFilterOperatorInvalid BadFilterOperatorUnsupported "
        "BadFilterOperandCountMismatch BadFilterElementInvalid BadFilterLiteralInvalid BadDeadbandFilterInvalid "
        "BadContinuationPointInvalid BadViewIdUnknown BadViewTimestampInvalid BadViewParameterMismatch "
        "BadViewVersionInvalid BadHistoryOperationInvalid BadHistoryOperationUnsupported BadTimestampNotSupported "
        "BadConditionAlreadyDisabled BadConditionAlreadyEnabled BadConditionDisabled BadConditionBranchAlreadyAcked "
        "BadConditionBranchAlreadyConfirmed BadConditionAlreadyShelved BadConditionNotShelved "
        "BadShelvingTimeOutOfRange BadEventIdUnknown BadEventNotAcknowledgeable BadDialogNotActive "
        "BadDialogResponseInvalid BadAggregateListMismatch BadAggregateNotSupported BadAggregateInvalidInputs "
        "BadAggregateConfigurationRejected BadBoundNotFound BadBoundNotSupported BadDataSetIdInvalid"
    ),
}
FAMILIES: dict[Family, frozenset[str]] = {family: frozenset(names.split()) for family, names in _SORTED.items()}
_OF: dict[str, Family] = {name: family for family, names in FAMILIES.items() for name in names}


def family_of(status: str) -> Family:
    """The family of a status by its name; "other" for a bad one that the standard does not have."""
    if status == "Good":
        return "good"
    if status.startswith(("Good", "Uncertain")):
        return "unsure"
    return _OF.get(status, "other")


# OPC UA status names of this control -> our exceptions: the one place that decides who must act.

Stage = Literal["login", "read", "write", "call"]

_TRANSPORT: dict[Family, str] = {"down": "E-UA-NCK-DOWN", "lost": "E-UA-LOST"}
_REFUSED: dict[Family, str] = {
    "rights": "E-UA-RIGHTS",
    "login": "E-UA-RIGHTS",
    "absent": "E-UA-LEVEL",  # of a call: the method is there, the access level at the panel is too low for it
    "busy": "E-UA-BUSY",
    "clock": "E-UA-CLOCK",
    "trust": "E-UA-TRUST-US",
    "limits": "E-UA-LIMIT",
    "licence": "E-UA-LICENCE",
    "type": "E-UA-TYPE",
    "file": "E-UA-FILE",
    "fault": "E-UA-FAULT",
}
_LOGIN: dict[Family, str] = {
    "rights": "E-UA-LOGIN",
    "login": "E-UA-LOGIN",
    "clock": "E-UA-CLOCK",
    "trust": "E-UA-TRUST-US",
    "limits": "E-UA-SESSIONS",
    "busy": "E-UA-SESSIONS",
    "licence": "E-UA-LICENCE",
    "fault": "E-UA-FAULT",
}


def is_lost(status: str) -> bool:
    """Whether a status means that session or channel are gone and a fresh client is needed."""
    return family_of(status) == "lost"


def is_down(status: str) -> bool:
    """Whether a status means that the server lives but the NCK behind it gives no value."""
    return family_of(status) == "down"


def is_absent(status: str) -> bool:
    """Whether the server has no such node."""
    return family_of(status) == "absent"


def is_not_yet(error: TrueflankError) -> bool:
    """Whether a read that failed so may succeed later, while a control restarts.

    Any status but a missing right and an absent node: no list of what a starting server answers would be complete.
    """
    status = error.fields.get("status")
    return isinstance(status, str) and family_of(status) not in ("good", "rights", "login", "absent")


def status_error(status: str, where: str, stage: Stage, what: str | Message) -> TrueflankError:
    """The exception for a bad status; ``what`` names the variable, method or user concerned."""
    kind = family_of(status)
    if stage == "login":
        return _login_error(status, where, what)
    if kind in ("unsure", "late"):
        return _uncertain_error(status, where, stage, what)
    if kind in _TRANSPORT:
        return TransportError(_TRANSPORT[kind], where, retryable=stage == "read", status=status, what=what)
    if kind == "absent" and not (status == "BadNotSupported" and stage == "call"):
        return UnsupportedDevice("E-UA-ABSENT", where, status=status, what=what)
    if kind == "protocol":
        return RemoteProtocolError("E-UA-PROTOCOL", where, why=f"{status}: {what}", status=status)
    return _login_refused(_REFUSED.get(kind, "E-UA-REFUSED"), where, status=status, what=what)


def _uncertain_error(status: str, where: str, stage: Stage, what: str | Message) -> TrueflankError:
    """Neither good nor bad: a value that is not live, or a write or call of which nobody knows the end."""
    if stage == "read":
        return TransportError("E-UA-STALE", where, retryable=True, what=what, why=status, status=status)
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
        raise status_error(bad[0][1], where, "write", bad[0][0])
    if bad:
        listed = "; ".join(f"{path} {status}" for path, status in bad)
        raise DeviceRefused("E-UA-PARTIAL", where, written=len(paths) - len(bad), refused=listed)


def translate_error(error: Exception, stage: Stage, where: str, url: str) -> TrueflankError:
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


def _login_error(status: str, where: str, user: str | Message) -> TrueflankError:
    kind = "trust" if status == "BadNoMatch" else family_of(status)  # so a server answers a policy it does not have
    if kind in ("down", "lost", "late", "unsure"):
        return TransportError("E-UA-LOST", where, retryable=True, status=status, what="login")
    if kind == "protocol":
        return RemoteProtocolError("E-UA-PROTOCOL", where, why=f"{status}: login", status=status)
    return _login_refused(_LOGIN.get(kind, "E-UA-REFUSED"), where, status=status, what="login", user=user)


def _login_refused(code: str, where: str, **fields: str | Message) -> DeviceRefused:
    """Whoever knows the clocks says by how much they differ; until then it is not known."""
    clock = {"ahead_s": "?"} if code == "E-UA-CLOCK" else {}
    return DeviceRefused(code, where, **(fields | clock))  # type: ignore[arg-type]
