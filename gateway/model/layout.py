"""A chain from the plain mapping of a site or error file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gateway.errors import ModelError
from gateway.model.axis import Axis, FixedLink
from gateway.model.chain import Chain, Element
from gateway.model.motion import motion_of

SIDES = ("work", "tool")
AXIS_KEYS = ("kind", "name", "axis", "err", "loc", "err_frame")
LINK_KEYS = ("kind", "xyz", "abc", "name")


def chain_of(data: Mapping[str, object]) -> Chain:
    """The chain of {"work": [...], "tool": [...]}, each side from the bed outward, mm and rad.

    An element has ``kind`` "prismatic" or "revolute" with ``name``, ``axis`` and, if wanted, ``err``, ``loc`` and
    ``err_frame``; or "fixed" with ``xyz`` and ``abc``. Raises ModelError E-CHAIN-... naming what is wrong.
    """
    for key in data:
        if key not in SIDES:
            raise ModelError("E-CHAIN-WORD", "chain", key="side", value=key, known=", ".join(SIDES))
    work, tool = (_side(data.get(side, ()), side) for side in SIDES)
    return Chain(work, tool)


def _side(elements: object, side: str) -> tuple[Element, ...]:
    if not isinstance(elements, Sequence) or isinstance(elements, str):
        raise ModelError("E-CHAIN-ELEMENT", side, why="a side is a list of elements")
    return tuple(_element(element, f"{side}[{number}]") for number, element in enumerate(elements))


def _element(data: object, where: str) -> Element:
    if not isinstance(data, Mapping):
        raise ModelError("E-CHAIN-ELEMENT", where, why="an element is a table of keys")
    known = LINK_KEYS if data.get("kind") == "fixed" else AXIS_KEYS
    for key in data:
        if key not in known:
            raise ModelError("E-CHAIN-WORD", where, key="key", value=key, known=", ".join(known))
    if data.get("kind") == "fixed":
        return FixedLink(data.get("xyz", (0.0, 0.0, 0.0)), data.get("abc", (0.0, 0.0, 0.0)))
    for key in AXIS_KEYS[:3]:
        if key not in data:
            raise ModelError("E-CHAIN-ELEMENT", where, why=f"key {key} is missing")
    for key in ("err", "loc"):
        if not isinstance(data.get(key, {}), Mapping):
            raise ModelError("E-CHAIN-ELEMENT", where, why=f"{key} is a table of keys")
    turning = data["kind"] == "revolute"
    err = {
        key: motion_of(value, f"{where} {key}", name=f"{key} of {data['name']}", turning=turning)
        for key, value in dict(data.get("err", {})).items()
    }
    frame = data.get("err_frame", "moving")
    return Axis(
        name=str(data["name"]),
        kind=data["kind"],
        direction=data["axis"],
        err=err,
        loc=dict(data.get("loc", {})),
        err_frame=frame,
    )
