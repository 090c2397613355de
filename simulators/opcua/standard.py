"""The standard address space, built once for the process and shared, and attributes of nodes that are not in it."""

from __future__ import annotations

import copy
import functools
import gc
from collections.abc import Iterator, MutableMapping

from asyncua import ua
from asyncua.server.address_space import AddressSpace, AttributeValue, NodeData, NodeManagementService
from asyncua.server.standard_address_space import standard_address_space


def status(name: str) -> ua.StatusCode:
    """An OPC UA status by its name."""
    return ua.StatusCode(getattr(ua.StatusCodes, name))


def attributes(node: ua.NodeId, kind: str) -> dict[ua.AttributeIds, ua.Variant]:
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


def own_copy(node: NodeData) -> NodeData:
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


class Layer(MutableMapping[ua.NodeId, NodeData]):
    """Nodes copied from a pristine set at first touch, so that servers of one process do not share state."""

    def __init__(self, pristine: dict[ua.NodeId, NodeData]) -> None:
        self._pristine = pristine
        self._own: dict[ua.NodeId, NodeData] = {}
        self._gone: set[ua.NodeId] = set()

    def __getitem__(self, key: ua.NodeId) -> NodeData:
        if key not in self._own:
            if key in self._gone:
                raise KeyError(key)
            self._own[key] = own_copy(self._pristine[key])
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
