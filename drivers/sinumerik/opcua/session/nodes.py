"""Names of the control <-> OPC UA node identifiers of the SinumerikVarProvider name space, their types, their values.

The paths are those of the Access MyMachine /OPC UA manuals (10/2015 to 05/2022) as far as they are public. Array
elements of machine data are 1-based there and 0-based in NC programs: this is the one place that converts. Not public,
hence keys of the site file: the serial number (`SERIAL_NUMBER`, MD18030) and the setting data folder `_N_NC_SEA_ACX`.
Every value, output of a method and time of a server passes `check_value` or one of its kind here.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from drivers.errors import RemoteProtocolError
from drivers.message import Message

# Paths.

NAMESPACE_URI = "SinumerikVarProvider"
METHODS = ("/Methods", "/Methods/Filehandling")
FILE_SYSTEM = "Sinumerik/FileSystem"
ALARM_SOURCE = "Sinumerik"
# Where an alarm type may keep its identifier: the control's own name space, or the CNC companion's.
ALARM_SPACES = (NAMESPACE_URI, "http://opcfoundation.org/UA/CNC", "http://opcfoundation.org/UA/CNC/")

Kind = Literal["Double", "String", "UInt16", "UInt32", "Boolean"]

R_FIRST, R_LAST = 0, 32535
CHANNEL_AREA = "/Channel/Parameter"
MACHINE_DATA = {
    "$MA_": "/NC/_N_AX_TEA_ACX",
    "$MC_": "/NC/_N_CH_TEA_ACX",
    "$MN_": "/NC/_N_NC_TEA_ACX",
    "$SN_": "/NC/_N_NC_SEA_ACX",
    "$SA_": "/NC/_N_AX_SEA_ACX",  # by analogy with the machine data: not printed where we looked
}
ACCESS_LEVEL = "/Nck/Configuration/accessLevel"
BASIC_LENGTH_UNIT = "/Nck/Configuration/basicLengthUnit"
NCK_VERSION = "/Nck/Configuration/nckVersion"
SERIAL_NUMBER = "/NC/_N_NC_TEA_ACX/$MN_HW_SERIAL_NUMBER[u1,1]"
OPERATING_MODE = "/Bag/State/opMode[u1]"
ALARM_COUNT = "/Nck/State/numAlarms"
MODES = ("JOG", "MDA", "AUTO")

_PATH = re.compile(
    r"(?P<area>(?:/[A-Za-z][A-Za-z0-9_]*|/_N_[A-Z0-9_]+)+)/(?P<name>\$?[A-Za-z_][A-Za-z0-9_]*)"
    r"(?:\[(?:u(?P<unit>\d{1,3})(?:, ?(?=\d)|(?=\])))?"
    r"(?P<first>\d{1,5})?(?:, ?(?P<count>#)?(?P<last>\d{1,5}))?\])?"
)
_NC_NAME = re.compile(r"(?P<name>R|\$[A-Z]{2}_[A-Z0-9_]+)(?:\[(?P<inside>[A-Za-z0-9_, ]+)\])?")
_DIRECTORIES = {"Part Program": "_N_MPF_DIR", "Sub Program": "_N_SPF_DIR", "Work Pieces": "_N_WKS_DIR"}
_EXTENSIONS = frozenset({"MPF", "SPF", "WPF", "WPD"})


@dataclass(frozen=True, slots=True)
class NodeAddress:
    """A node identifier taken apart: area, name, unit (axis or channel, 1-based), element or block."""

    area: str
    name: str
    unit: int | None = None
    first: int | None = None
    last: int | None = None

    @property
    def path(self) -> str:
        """The identifier to put after ``ns=n;s=``."""
        inside = [f"u{self.unit}"] if self.unit is not None else []
        inside += [str(number) for number in (self.first, self.last) if number is not None]
        return f"{self.area}/{self.name}" + (f"[{','.join(inside)}]" if inside else "")

    @property
    def elements(self) -> tuple[int, ...]:
        """Element numbers this address names; empty for a scalar."""
        if self.first is None:
            return ()
        return tuple(range(self.first, (self.first if self.last is None else self.last) + 1))


@functools.lru_cache(maxsize=4096)
def parse(path: str) -> NodeAddress | None:
    """Take an identifier apart; None when it is not of the control's form. A blank may follow a comma."""
    match = _PATH.fullmatch(path)
    if match is None or path.endswith("[]"):
        return None
    unit, first, last = (int(match[key]) if match[key] else None for key in ("unit", "first", "last"))
    if match["count"] and first is not None and last is not None:
        last = first + last - 1
    if last is not None and (first is None or last < first):
        return None
    return NodeAddress(area=match["area"], name=match["name"], unit=unit, first=first, last=last)


def r_parameter(number: int, channel: int = 1) -> str:
    """Identifier of one R parameter (Double)."""
    return NodeAddress(CHANNEL_AREA, "R", channel, number).path


def r_block(first: int, count: int, channel: int = 1) -> str:
    """Identifier of ``count`` consecutive R parameters, read as one array."""
    return NodeAddress(area=CHANNEL_AREA, name="R", unit=channel, first=first, last=first + count - 1).path


def in_channel(name: str, channel: int = 1, block: str = "State") -> str:
    """Identifier of a channel variable: chanStatus, progStatus; block ProgramInfo: msg, progName."""
    return NodeAddress(f"/Channel/{block}", name, None if channel == 1 else channel).path


def of_axis(name: str, axis_number: int, channel: int = 1) -> str:
    """Identifier of a machine axis variable; ``axis_number`` counts from 1: aaStat, aaRef, actToolBasePos."""
    return NodeAddress("/Channel/MachineAxis", name, channel, axis_number).path


def alarm_number(place: int) -> str:
    """Identifier of the number of the ``place``-th pending alarm, 1-based; 0 there means none."""
    return NodeAddress("/Nck/SequencedAlarms", "alarmNo", 1, place).path


def alarm_text(place: int) -> str:
    """Identifier of the first fill text of the ``place``-th pending alarm."""
    return NodeAddress("/Nck/SequencedAlarms", "fillText1", 1, place).path


def axis_name(place: int) -> str:
    """Identifier of MD10000, the name of machine axis ``place``, 1-based."""
    return NodeAddress(MACHINE_DATA["$MN_"], "$MN_AXCONF_MACHAX_NAME_TAB", 1, place).path


def to_path(name: str, axes: Sequence[str], channel: int = 1) -> str | None:
    """An NC program's name of an R parameter, machine or setting datum -> identifier; None if it has none.

    ``axes`` are the machine axis names by number, "" where there is none.
    ``$AA_ENC_COMP`` and ``$AN_CEC`` have no public node.
    """
    match = _NC_NAME.fullmatch(name)
    if match is None:
        return None
    inside = [part.strip() for part in (match["inside"] or "").split(",") if part.strip()]
    if match["name"] == "R":
        return r_parameter(int(inside[0]), channel) if len(inside) == 1 and inside[0].isdigit() else None
    area = MACHINE_DATA.get(match["name"][:4])
    return _datum_path(area, match["name"], inside, axes, channel) if area else None


def _datum_path(area: str, name: str, inside: list[str], axes: Sequence[str], channel: int) -> str | None:
    unit = channel if name.startswith("$MC_") else 1
    if name.startswith(("$MA_", "$SA_")):
        if not inside or inside[-1] not in axes:
            return None
        unit = list(axes).index(inside.pop()) + 1
    elif not inside:
        return NodeAddress(area, name, unit if unit != 1 else None).path
    if len(inside) > 1 or not all(part.isdigit() for part in inside):
        return None
    return NodeAddress(area, name, unit, int(inside[0]) + 1 if inside else None).path


def to_names(address: NodeAddress, axes: Sequence[str]) -> tuple[str, ...]:
    """The NC names behind an identifier, one for each element; empty when it is not such a datum."""
    if (address.area, address.name) == (CHANNEL_AREA, "R"):
        return tuple(f"R[{number}]" for number in address.elements if R_FIRST <= number <= R_LAST)
    if MACHINE_DATA.get(address.name[:4]) != address.area:
        return ()
    axis = ""
    if address.name.startswith(("$MA_", "$SA_")):
        if not 1 <= (address.unit or 1) <= len(axes):
            return ()
        axis = axes[(address.unit or 1) - 1]
        if not axis:  # no axis of this number
            return ()
    if not address.elements:
        return (f"{address.name}[{axis}]" if axis else address.name,)
    if address.elements[0] < 1:
        return ()
    tail = f",{axis}" if axis else ""
    return tuple(f"{address.name}[{number - 1}{tail}]" for number in address.elements)


@functools.lru_cache(maxsize=4096)
def kind_of(path: str) -> Kind:
    """The variant type a value of this identifier carries on the wire."""
    address = parse(path)
    if address is None:
        return "String"
    if address.name in _KINDS:
        return _KINDS[address.name]
    return "Double"


_KINDS: dict[str, Kind] = {
    "chanStatus": "UInt16",
    "progStatus": "UInt16",
    "opMode": "UInt16",
    "aaStat": "UInt16",
    "aaRef": "UInt16",
    "numAlarms": "UInt16",
    "accessLevel": "UInt16",
    "basicLengthUnit": "UInt16",
    "alarmNo": "UInt32",
    "actLineNumber": "UInt32",
    "msg": "String",
    "$MC_DIAMETER_AX_DEF": "String",
    "progName": "String",
    "selectedWorkPProg": "String",
    "fillText1": "String",
    "nckVersion": "String",
    "$MN_HW_SERIAL_NUMBER": "String",
    "$MN_AXCONF_MACHAX_NAME_TAB": "String",
    "$MA_ENC_COMP_ENABLE": "Boolean",
    "$MA_CEC_ENABLE": "Boolean",
    "$SN_CEC_TABLE_ENABLE": "Boolean",
    "$MA_IS_ROT_AX": "Boolean",
    "$MA_ROT_IS_MODULO": "Boolean",
    "$MN_SCALING_SYSTEM_IS_METRIC": "Boolean",
    "$MA_MM_ENC_COMP_MAX_POINTS": "UInt32",
    "$MN_MM_CEC_MAX_POINTS": "UInt32",
}


def to_file(nck_path: str) -> str | None:
    """A file of the control (``/_N_MPF_DIR/_N_NAME_MPF``) -> its path in the server's file system."""
    parts = nck_path.split("/")
    folders = {directory: label for label, directory in _DIRECTORIES.items()}
    if len(parts) < 3 or parts[0] or parts[1] not in folders:
        return None
    names = []
    for part in parts[2:]:
        stem, separator, extension = part.removeprefix("_N_").rpartition("_")
        if not part.startswith("_N_") or not separator or extension not in _EXTENSIONS:
            return None
        names.append(f"{stem}.{extension}")
    return "/".join((FILE_SYSTEM, folders[parts[1]], *names))


def from_file(path: str) -> str | None:
    """A path in the server's file system -> the control's own name; None for a wrong tree or extension."""
    if not path.startswith(FILE_SYSTEM + "/"):
        return None
    folder, *names = path.removeprefix(FILE_SYSTEM + "/").split("/")
    if folder not in _DIRECTORIES or not names:
        return None
    parts = []
    for name in names:
        stem, _, extension = name.upper().partition(".")
        if not re.fullmatch(r"[A-Z0-9_]{1,24}", stem) or extension not in _EXTENSIONS:
            return None
        parts.append(f"_N_{stem}_{extension}")
    return "/" + "/".join((_DIRECTORIES[folder], *parts))


# What a value of the control must be: the one place where values, outputs of methods and times of a server enter.
#
# Type, range, number of elements and special numbers are checked here against `nodes.kind_of`; what passes is of plain
# Python: str, bool, int, float, a list of them for a block, bytes. Servers differ in the width of their numbers, so 2
# and 2.0 are one, and a switch may be 0 or 1; a truth value is no number, NaN and infinity are none either.

SHOWN = 80
_MOST = {"UInt16": 0xFFFF, "UInt32": 0xFFFFFFFF, "UInt64": 2**64 - 1}
# Properties of file nodes (OPC 10000-20, 4.2.1).
_OF_FILES = {"UserWritable": "Boolean", "Writable": "Boolean", "Size": "UInt64", "OpenCount": "UInt16"}
# Variables that know fewer values than their type can carry.
_FEW = {"basicLengthUnit": 1, "aaRef": 1, "accessLevel": 7}


def check_value(path: str, value: Any, where: str) -> Any:
    """A value read from a node, as plain Python. Raises RemoteProtocolError (E-UA-VALUE)."""
    address = parse(path)
    if address is None or address.last is None:
        return _check_single(path, value, path, where)
    count = len(address.elements)
    if not isinstance(value, list) or len(value) != count:
        raise value_error(path, value, f"{count} numbers", where)
    return [_check_single(path, one, f"{path}, element {number}", where) for number, one in enumerate(value, start=1)]


def _check_single(path: str, value: Any, what: str, where: str) -> Any:
    address = parse(path)
    kind = _OF_FILES.get(path.rpartition(".")[2]) if address is None else kind_of(path)
    kind = kind or "String"
    if kind in _MOST:
        name = address.name if address is not None else ""
        return check_whole(value, what, where, _FEW.get(name, _MOST[kind]))
    return _CHECKS[kind](value, what, where)


def check_whole(value: Any, what: str, where: str, most: int = _MOST["UInt32"]) -> int:
    """A whole number from 0 to ``most``. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not _is_number(value) or value != int(value) or not 0 <= value <= most:
        raise value_error(what, value, Message.of("W-UA-WHOLE", most=most), where)
    return int(value)


def check_number(value: Any, what: str, where: str) -> float:
    """A finite number. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not _is_number(value):
        raise value_error(what, value, "a number", where)
    return float(value)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:  # a whole number that no Double holds
        return False


def check_text(value: Any, what: str, where: str) -> str:
    """A text; one that is not there (a null String) is empty. Raises RemoteProtocolError (E-UA-VALUE)."""
    if value is not None and not isinstance(value, str):
        raise value_error(what, value, "a text", where)
    return value or ""


def check_label(value: Any, what: str, where: str) -> str:
    """A name or number as people read it: some controls give their version as a number. Raises as `check_text`."""
    return f"{value:g}" if _is_number(value) else check_text(value, what, where).strip()


def check_switch(value: Any, what: str, where: str) -> bool:
    """On or off. Raises RemoteProtocolError (E-UA-VALUE)."""
    if isinstance(value, bool):
        return value
    if not _is_number(value) or value not in (0, 1):
        raise value_error(what, value, Message.of("W-UA-ON-OFF"), where)
    return bool(value)


def check_content(value: Any, what: str, where: str) -> bytes:
    """The bytes of a file. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not isinstance(value, bytes):
        raise value_error(what, value, "bytes", where)
    return value


def check_time(value: Any, what: str | Message, where: str) -> datetime | None:
    """A time by the server's clock, UTC and naive; None where there is none. Raises as `check_text`."""
    if value is not None and not isinstance(value, datetime):
        raise value_error(what, value, "a time", where)
    return value.replace(tzinfo=None) if value is not None else None


def check_duration(milliseconds: Any, what: str | Message, where: str) -> float:
    """How long a server keeps something, s. Raises RemoteProtocolError (E-UA-VALUE) for what is no time at all."""
    if not _is_number(milliseconds) or milliseconds <= 0:
        raise value_error(what, milliseconds, "a time above 0 ms", where)
    return float(milliseconds) / 1000.0


def method_output(results: Sequence[Any], place: int, what: str, where: str) -> Any:
    """One output of a method. Raises RemoteProtocolError (E-UA-VALUE) where there are too few."""
    if len(results) <= place:
        raise value_error(what, list(results), f"{place + 1} outputs", where)
    return results[place]


def value_error(what: str | Message, value: Any, wanted: str | Message, where: str) -> RemoteProtocolError:
    """The error for a value that cannot be: which variable, what it was, what it must be."""
    return RemoteProtocolError("E-UA-VALUE", where, what=what, value=_shown(value), wanted=wanted)


def _shown(value: Any) -> str | Message:
    if value is None:
        return "nothing"
    try:
        told = repr(value)
    except ValueError:  # Python does not write down a number of thousands of digits
        return Message.of("W-UA-ENDLESS")
    return told if len(told) <= SHOWN else told[: SHOWN - 3] + "..."


_CHECKS: dict[str, Callable[[Any, str, str], Any]] = {
    "Double": check_number,
    "String": check_text,
    "Boolean": check_switch,
}
