"""What a bridge's refusals mean to us: each error code to the exception that says who must act."""

from __future__ import annotations

from drivers.bridge.codec import BridgeRefusal
from drivers.bridge.records import (
    BATTERY_LOW,
    BEAM_OBSTRUCTED,
    BUSY,
    INVALID_PARAMS,
    INVALID_REQUEST,
    METHOD_NOT_FOUND,
    NOT_REFERENCED,
    PARSE_ERROR,
    UNSUPPORTED,
)
from drivers.errors import BeamObstructed, DeviceRefused, LocalProtocolError, NotReferenced, TrueflankError

CANNOT = (UNSUPPORTED, METHOD_NOT_FOUND)
OUR_FAULT = (PARSE_ERROR, INVALID_REQUEST, INVALID_PARAMS)


def exception_for(refusal: BridgeRefusal, method: str, where: str) -> TrueflankError:
    """The exception for a refusal of `method`, with the bridge's own sentence in its fields."""
    said = refusal.message
    if refusal.code in CANNOT:
        return DeviceRefused("E-BRIDGE-UNSUPPORTED", where, method=method, said=said)
    if refusal.code in OUR_FAULT:
        return LocalProtocolError("E-BRIDGE-REJECTED", where, method=method, said=said, number=refusal.code)
    if refusal.code == BEAM_OBSTRUCTED:
        return BeamObstructed("E-BRIDGE-BEAM", where, method=method, said=said)
    if refusal.code == NOT_REFERENCED:
        return NotReferenced("E-BRIDGE-REFERENCE", where, said=said)
    if refusal.code == BUSY:
        return DeviceRefused("E-BRIDGE-BUSY", where, said=said)
    if refusal.code == BATTERY_LOW:
        return DeviceRefused("E-BRIDGE-BATTERY", where, said=said)
    return DeviceRefused("E-BRIDGE-REFUSED", where, method=method, said=said, number=refusal.code)
