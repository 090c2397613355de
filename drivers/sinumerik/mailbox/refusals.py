"""What a refusal means: exceptions of Modbus, a wrong map, and the mailbox's error codes 1-14."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from drivers.errors import (
    DeviceRefused,
    PointsDiffer,
    RemoteProtocolError,
    TableActs,
    TooManyPoints,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    ValueOutOfRange,
)
from drivers.sinumerik.mailbox.codec.commands import Order
from drivers.sinumerik.mailbox.codec.packing import WordOrder, order_of
from drivers.sinumerik.mailbox.codec.readings import Status
from drivers.sinumerik.mailbox.codec.registers import MAGIC, MAP_VERSION, RefusalCode

BUSY = (5, 6)
_MAP = {1: "E-MODBUS-NO-FUNCTION", 2: "E-MODBUS-NO-ADDRESS", 3: "E-MODBUS-NO-VALUE"}
_CODES: Mapping[int, tuple[type[TrueflankError], str]] = {
    RefusalCode.CRC: (RemoteProtocolError, "E-MBX-CRC"),
    RefusalCode.ORDER: (DeviceRefused, "E-MBX-ORDER"),
    RefusalCode.LENGTH: (DeviceRefused, "E-MBX-LENGTH"),
    RefusalCode.VALUE: (ValueOutOfRange, "E-MBX-VALUE"),
    RefusalCode.NOT_RELEASED: (DeviceRefused, "E-MBX-NOT-RELEASED"),
    RefusalCode.NOT_IN_RESET: (DeviceRefused, "E-MBX-NOT-IN-RESET"),
    RefusalCode.WRITE_PROTECTED: (TableActs, "E-MBX-PROTECTED"),
    RefusalCode.POINTS: (TooManyPoints, "E-MBX-POINTS"),
    RefusalCode.UNKNOWN: (UnsupportedDevice, "E-MBX-UNKNOWN"),
    RefusalCode.MISMATCH: (PointsDiffer, "E-MBX-MISMATCH"),
    RefusalCode.NCK: (DeviceRefused, "E-MBX-NCK"),
    RefusalCode.TIME: (DeviceRefused, "E-MBX-TIME"),
    RefusalCode.SESSION_LOST: (DeviceRefused, "E-MBX-SESSION-LOST"),
    RefusalCode.TAKEN: (DeviceRefused, "E-MBX-TAKEN"),
}


def exception_refusal(exception: int, function: int, first: int, last: int, where: str) -> TrueflankError:
    """The error of an exception reply (Modbus Application Protocol V1.1b3, p. 47): 1-3 the map, 4 and 8 the device,
    5 and 6 busy, 10 and 11 a gateway between, which counts as a lost wire; any other is against the rules."""
    fields: dict[str, Any] = {"first": first, "last": last, "function": function}
    if exception in _MAP:
        return UnsupportedDevice(_MAP[exception], where, **fields)
    if exception in (4, 8):
        return DeviceRefused("E-MODBUS-FAILED", where, exception=exception, **fields)
    if exception in BUSY:
        return DeviceRefused("E-MODBUS-BUSY", where, **fields)
    if exception in (10, 11):
        return TransportError("E-MODBUS-GATEWAY", where, exception=exception, **fields)
    return RemoteProtocolError("E-MODBUS-EXCEPTION", where, exception=exception, **fields)


def refusal(status: Status, order: Order, where: str) -> TrueflankError:
    """The error of a command that the PLC answered with its error bit."""
    fields: dict[str, Any] = {"command": order.command.name, "detail": status.detail}
    kind, code = _CODES.get(status.error, (RemoteProtocolError, "E-MBX-ERROR-CODE"))
    if code == "E-MBX-ERROR-CODE":
        fields["error"] = status.error
    return kind(code, where, **fields)


def check_map(registers: Sequence[int], order: WordOrder, where: str) -> None:
    """Magic, version and word order, before anything else is believed.

    Raises UnsupportedDevice: E-MBX-WORD-ORDER says which setting would be right; E-MBX-MAGIC (no mailbox, bytes
    swapped, addresses shifted), E-MBX-OLD-MAP, E-MBX-VERSION. Nothing is adapted silently.
    """
    found = order_of(registers)
    if found not in ("high-first", "low-first"):
        raise UnsupportedDevice("E-MBX-MAGIC", where, found=f"{registers[0]:04X}", wanted=f"{MAGIC:04X}", why=found)
    if registers[1] != MAP_VERSION:
        code = "E-MBX-OLD-MAP" if registers[1] < MAP_VERSION else "E-MBX-VERSION"
        raise UnsupportedDevice(code, where, found=registers[1], wanted=MAP_VERSION)
    if found != order:
        raise UnsupportedDevice("E-MBX-WORD-ORDER", where, found=found, setting=order)
