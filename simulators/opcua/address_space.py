"""The server's address space: users and their rights, variables by identifier, and the shared standard nodes.

Rights: Access MyMachine /OPC UA 12/2017, p. 950. The standard nodes are built once for a process; each server copies a
node at its first touch, because building them takes a second.
"""

from __future__ import annotations

import copy
import functools
import gc
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace, AttributeValue, NodeData, NodeManagementService
from asyncua.server.standard_address_space import standard_address_space

from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.nodes import Kind, NodeAddress
from simulators.nck import Nck, NckRefusal

RIGHTS = frozenset(
    {
        *(
            f"{area}{act}"
            for area in ("State", "Frame", "Sea", "Tea", "Tool", "Drive", "Gud")
            for act in ("Read", "Write")
        ),
        *("FsRead", "FsWrite", "PlcRead", "PlcWrite", "AlarmRead", "RandomRead", "RandomWrite"),
        *("SinuReadAll", "SinuWriteAll", "ApWrite"),
    }
)
# Files and program selection are not contained in the two collective rights.
_NOT_COLLECTIVE = frozenset({"FsRead", "FsWrite", "ApWrite", "RandomRead", "RandomWrite"})


@dataclass(frozen=True, slots=True)
class Account:
    """One user: a password and rights. The anonymous account has none and may only look at the server."""

    name: str
    password: str = ""
    rights: frozenset[str] = frozenset()

    def may(self, right: str) -> bool:
        """Whether the account has a right, by itself or through a collective one."""
        if right.casefold() in {one.casefold() for one in self.rights}:
            return True
        if right in _NOT_COLLECTIVE:
            return False
        return ("SinuReadAll" if right.endswith("Read") else "SinuWriteAll") in self.rights


ANONYMOUS = Account("")
ADMINISTRATOR = Account("OpcUaClient", "OpcUaClient", frozenset({"SinuReadAll"}))
GATEWAY_RIGHTS = frozenset({"SinuReadAll", "StateWrite", "FsRead", "FsWrite", "ApWrite", "AlarmRead"})


def make_accounts(users: Mapping[str, Any]) -> dict[str, Account]:
    """Accounts from a cell file: name -> password, or name -> {password, rights}. Raises ValueError."""
    accounts = {ADMINISTRATOR.name: ADMINISTRATOR}
    for name, given in users.items():
        entry = {"password": given} if isinstance(given, str) else dict(given)
        rights = frozenset(entry.get("rights", GATEWAY_RIGHTS))
        known = {right.casefold() for right in RIGHTS}
        unknown = sorted(right for right in rights if right.casefold() not in known)
        if unknown:
            raise ValueError(f"user {name}: unknown rights {unknown}")
        accounts[name] = Account(name, str(entry.get("password", name)), rights)
    return accounts


# Identifiers -> state, R parameters and machine data of the NCK.

Value = float | int | str | bool


class StatusRefused(Exception):
    """The server says no, by the name of an OPC UA status; of a call also by one status for each argument."""

    def __init__(self, status: str, arguments: tuple[str, ...] = ()) -> None:
        super().__init__(status)
        self.status = status
        self.arguments = arguments


# The right each area asks for, by the first entry that fits.
_AREAS = {
    "/Channel": "State",
    "/Nck": "State",
    "/Bag": "State",
    "/NC/_N_NC_SEA_ACX": "Sea",
    "/NC": "Tea",
}
HARDWARE = "/Nck/Configuration/nckType"
_WRITE_LEVEL = 7  # protection level handed to the NCK with a write over OPC UA: the lowest


class VariableSpace:
    """Reads and writes by identifier for one account at a time."""

    def __init__(self, nck: Nck, starts: Callable[[], str] = lambda: "BadCommunicationError") -> None:
        self._nck = nck
        self._starts = starts
        self._axes = nck.spec.places
        self._channel: dict[str, Callable[[], Value]] = {
            "/Channel/State/chanStatus": lambda: int(nck.channel_status),
            "/Channel/State/progStatus": lambda: int(nck.program_status),
            "/Channel/State/chanAlarm": lambda: int(bool(nck.alarms)),
            "/Channel/ProgramInfo/msg": lambda: str(nck.message),
            "/Channel/ProgramInfo/progName": lambda: str(nck.selected),
            "/Channel/ProgramInfo/selectedWorkPProg": lambda: str(nck.selected),
            "/Channel/ProgramInfo/actLineNumber": lambda: int(nck.program_line),
            "/Bag/State/opMode": lambda: nodes.MODES.index(nck.mode),
        }
        self._nck_wide: dict[str, Callable[[], Value]] = {
            nodes.ACCESS_LEVEL: lambda: int(nck.access_level),
            nodes.BASIC_LENGTH_UNIT: lambda: 0 if nck.spec.unit_system == "metric" else 1,
            nodes.NCK_VERSION: lambda: nck.spec.identity[1],
            HARDWARE: lambda: nck.spec.identity[2],
            nodes.ALARM_COUNT: lambda: len(nck.alarms),
            "/Nck/TopPrioAlarm/alarmNo": lambda: self._alarm(1),
            "/Nck/LastAlarm/alarmNo": lambda: self._alarm(len(nck.alarms)),
        }
        self._axis: dict[str, Callable[[str], Value]] = {
            "actToolBasePos": lambda name: float(nck.axis_state(name).actual_position),
            "measPos1": lambda name: float(nck.axis_state(name).encoder_position),
            "cmdContrPos": lambda name: float(nck.axis_state(name).set_position),
            "aaStat": nck.axis_stat,
            "aaRef": lambda name: int(nck.core.axis(name).referenced),
            "vaEnc1CompVal": lambda name: float(nck.get(f"$VA_ENC1_COMP_VAL[{name}]")),
            "vaEnc2CompVal": lambda name: float(nck.get(f"$VA_ENC2_COMP_VAL[{name}]")),
            "vaCecCompVal": lambda name: float(nck.axis_state(name).cec_value),
        }

    def first_elements(self) -> list[str]:
        """Identifiers a browse shows: the first element of everything, no more."""
        axis = [nodes.of_axis(name, 1) for name in self._axis]
        listed = [nodes.r_parameter(1), *self._channel, *self._nck_wide, *axis, nodes.alarm_number(1)]
        return [*listed, nodes.axis_name(1), nodes.SERIAL_NUMBER]

    def read(self, path: str, account: Account) -> tuple[Kind, Value | list[Value]]:
        """Kind and value behind an identifier. Raises Refused with the status the server gives."""
        address = nodes.parse(path)
        if address is None:
            raise StatusRefused("BadNodeIdUnknown")
        if not account.may(_right(address, "Read")):
            raise StatusRefused("BadUserAccessDenied")
        if self._nck.booting:
            raise StatusRefused(self._starts())
        values = self._values(address)
        kind = nodes.kind_of(address.path)
        return kind, (list(values) if address.last is not None else values[0])

    def _values(self, address: NodeAddress) -> list[Value]:
        names = nodes.to_names(address, self._axes)
        if names:
            return [self._datum(name) for name in names]
        if address.area == "/Channel/MachineAxis" and address.unit in (None, 1):
            return [self._axis_value(address.name, number) for number in address.elements or (1,)]
        if address.area == "/Nck/SequencedAlarms":
            return [self._alarm_field(address.name, number) for number in address.elements or (1,)]
        getter = self._nck_wide.get(f"{address.area}/{address.name}")
        if getter is None and address.unit in (None, 1):
            getter = self._channel.get(f"{address.area}/{address.name}")
        if getter is None or address.elements:
            raise StatusRefused("BadAttributeIdInvalid")
        return [getter()]

    def _axis_value(self, name: str, number: int) -> Value:
        getter = self._axis.get(name)
        if getter is None or not 1 <= number <= len(self._axes) or not self._axes[number - 1]:
            raise StatusRefused("BadAttributeIdInvalid")
        return getter(self._axes[number - 1])

    def _alarm(self, place: int) -> int:
        alarms = self._nck.alarms
        return int(alarms[place - 1].number) if 1 <= place <= len(alarms) else 0

    def _alarm_field(self, name: str, place: int) -> Value:
        if name == "alarmNo":
            return self._alarm(place)
        if name != "fillText1":
            raise StatusRefused("BadAttributeIdInvalid")
        alarms = self._nck.alarms
        return str(alarms[place - 1].text) if 1 <= place <= len(alarms) else ""

    def _datum(self, name: str) -> Value:
        own = self._own_datum(name)
        if own is not None:
            return own
        try:
            value: Any = self._nck.get(name)
        except NckRefusal as refusal:
            raise StatusRefused("BadAttributeIdInvalid") from refusal
        return value if isinstance(value, (bool, int, float)) else str(value)

    def _own_datum(self, name: str) -> Value | None:
        """Machine data that describe the configuration itself; None where the NCK knows better."""
        stem, _, inside = name.partition("[")
        inside = inside.rstrip("]")
        if stem == "$MN_AXCONF_MACHAX_NAME_TAB":
            place = int(inside)
            return self._axes[place] if place < len(self._axes) else ""
        if stem == "$MN_HW_SERIAL_NUMBER":
            return self._nck.spec.identity[0] if inside == "0" else ""
        if stem in ("$MA_IS_ROT_AX", "$MA_ROT_IS_MODULO"):
            axis = next(one for one in self._nck.spec.axes if one.name == inside)
            return bool(axis.rotary if stem == "$MA_IS_ROT_AX" else axis.modulo)
        return None

    def may_write(self, path: str, account: Account) -> bool:
        """What a node's UserAccessLevel says of writing."""
        address = nodes.parse(path)
        if address is None or not nodes.to_names(address, self._axes):
            return False
        if (address.area, address.name) == (nodes.CHANNEL_AREA, "R") and not self._nck.spec.r_writable:
            return False
        return account.may(_right(address, "Write"))

    def write(self, path: str, values: list[Value], account: Account) -> None:
        """Write one element or a block. Raises Refused; nothing is written then."""
        address = nodes.parse(path)
        if address is None:
            raise StatusRefused("BadNodeIdUnknown")
        if not account.may(_right(address, "Write")):
            raise StatusRefused("BadUserAccessDenied")
        if self._nck.booting:
            raise StatusRefused(self._starts())
        names = nodes.to_names(address, self._axes)
        if not names:
            raise StatusRefused("BadNotWritable")
        if len(names) != len(values):
            raise StatusRefused("BadTypeMismatch")
        for name, value in zip(names, values, strict=True):
            try:
                self._nck.set(name, value, _WRITE_LEVEL)
            except NckRefusal as refusal:
                raise StatusRefused("BadUserAccessDenied") from refusal


def _right(address: NodeAddress, act: str) -> str:
    whole = f"{address.area}/"
    for start, right in _AREAS.items():
        if whole.startswith(f"{start}/"):
            return f"{right}{act}"
    raise StatusRefused("BadAttributeIdInvalid")


# Standard nodes, and attributes of variables that have no node.


def status_code(name: str) -> ua.StatusCode:
    """An OPC UA status by its name."""
    return ua.StatusCode(getattr(ua.StatusCodes, name))


def made_up_attributes(node: ua.NodeId, kind: str) -> dict[ua.AttributeIds, ua.Variant]:
    """What a browsable variable would say of itself, made up for an element without a node."""
    name = str(node.Identifier).rpartition("/")[2]
    readable = ua.Variant(1, ua.VariantType.Byte)
    return {
        ua.AttributeIds.NodeId: ua.Variant(node, ua.VariantType.NodeId),
        ua.AttributeIds.NodeClass: ua.Variant(int(ua.NodeClass.Variable), ua.VariantType.Int32),
        ua.AttributeIds.BrowseName: ua.Variant(
            ua.QualifiedName(name, node.NamespaceIndex), ua.VariantType.QualifiedName
        ),
        ua.AttributeIds.DisplayName: ua.Variant(ua.LocalizedText(name), ua.VariantType.LocalizedText),
        ua.AttributeIds.DataType: ua.Variant(ua.NodeId(getattr(ua.ObjectIds, kind)), ua.VariantType.NodeId),
        ua.AttributeIds.ValueRank: ua.Variant(-1, ua.VariantType.Int32),
        ua.AttributeIds.AccessLevel: readable,
        ua.AttributeIds.UserAccessLevel: readable,
    }


@functools.cache
def standard_nodes() -> dict[ua.NodeId, NodeData]:
    """The nodes of the standard; not to be changed."""
    space, collecting = AddressSpace(), gc.isenabled()
    gc.disable()  # of the million objects made here all stay: looking for garbage among them is a fifth of the time
    try:
        standard_address_space.fill_address_space(NodeManagementService(space))
    finally:
        if collecting:
            gc.enable()
    return {node: space[node] for node in space.keys()}  # noqa: SIM118 - not a mapping


def copy_node(node: NodeData) -> NodeData:
    """A node that may be changed as a server does it.

    A value is replaced, never changed in place, and stays shared; attributes, their callbacks and references are own.
    A deep copy costs a hundred times as much, and a browse touches hundreds of nodes.
    """
    own = NodeData(node.nodeid)
    own.call = node.call
    own.references = [copy.copy(reference) for reference in node.references]
    for key, attribute in node.attributes.items():
        own.attributes[key] = AttributeValue(attribute.value)
        own.attributes[key].value_callback = attribute.value_callback
        own.attributes[key].value_setter = attribute.value_setter
    return own


class NodeLayer(MutableMapping[ua.NodeId, NodeData]):
    """Nodes copied from a pristine set at first touch, so that servers of one process do not share state."""

    def __init__(self, pristine: dict[ua.NodeId, NodeData]) -> None:
        self._pristine = pristine
        self._own: dict[ua.NodeId, NodeData] = {}
        self._gone: set[ua.NodeId] = set()

    def __getitem__(self, key: ua.NodeId) -> NodeData:
        if key not in self._own:
            if key in self._gone:
                raise KeyError(key)
            self._own[key] = copy_node(self._pristine[key])
        return self._own[key]

    def __setitem__(self, key: ua.NodeId, value: NodeData) -> None:
        self._gone.discard(key)
        self._own[key] = value

    def __delitem__(self, key: ua.NodeId) -> None:
        if key not in self:
            raise KeyError(key)
        self._own.pop(key, None)
        self._gone.add(key)

    def __contains__(self, key: object) -> bool:
        return key in self._own or (key in self._pristine and key not in self._gone)

    def __iter__(self) -> Iterator[ua.NodeId]:
        yield from self._own
        yield from (key for key in self._pristine if key not in self._own and key not in self._gone)

    def __len__(self) -> int:
        return sum(1 for _ in self)
