"""The status codes of the OPC UA standard, sorted into families by what a person can do about them.

Names as in OPC 10000-6, annex A.2. The severity bits alone sort what is neither good nor bad. A name that is in no
family is a maker's own code: "other", which is refused and, after an activation, waited through like any other.
"""

from __future__ import annotations

from typing import Literal

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


def family(status: str) -> Family:
    """The family of a status by its name; "other" for a bad one that the standard does not have."""
    if status == "Good":
        return "good"
    if status.startswith(("Good", "Uncertain")):
        return "unsure"
    return _OF.get(status, "other")
