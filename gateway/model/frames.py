"""The frames of a chain by name, the matrices between them, and the six relative errors of wheel to work (mm, rad).

A side runs from the bed outward: each moving axis and each fixed link brings a frame of its own. The last frame of the
work side is the work, that of the tool side the wheel; where the last element is an axis, work or wheel is fixed to it
and their matrix is the identity. A matrix carries coordinates of one frame into those of another,

    p_into = T p_frame        T(into <- frame) = inv(T_bed,into) T_bed,frame

and three states of it are told apart. *Ideal* has no errors. *Actual* has every error as an exact rotation. *Small
angle* has the linear matrix I + hat(e) for every error, multiplied out without dropping products: what a derivation by
hand writes down. It is no rotation; its determinant differs from 1 by the square of the angles.

The relative error of wheel to work is the motion that leads from the ideal to the actual matrix. It can be told in the
work, T_act = E T_id, or in the wheel, T_act = T_id E. Both are the same motion seen from two places; lengths
differ by the lever of the angles. To first order E = I + hat(xi) with the six numbers xi = (dx, dy, dz, ea, eb, ec).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import Message
from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.model import transforms
from gateway.model.chain import Axis, Chain, Element, FixedLink, Frame, Positions, position
from gateway.model.motion import motion_of

State = Literal["ideal", "actual", "small-angle"]
RelativeOrder = Literal["exact", "first", "small-angle"]
STATES: tuple[State, ...] = ("ideal", "actual", "small-angle")
RELATIVE_ORDERS: tuple[RelativeOrder, ...] = ("exact", "first", "small-angle")
RELATIVE = ("dx", "dy", "dz", "ea", "eb", "ec")
BED, WORK, WHEEL = "bed", "work", "wheel"


@dataclass(frozen=True, slots=True)
class Joint:
    """One frame of a chain on its parent; ``element`` is what lies between them, None for an identity."""

    frame: str
    parent: str
    side: Literal["work", "tool"]
    element: Element | None

    @property
    def moving(self) -> bool:
        """Whether an axis lies between frame and parent."""
        return isinstance(self.element, Axis)


def joints(chain: Chain) -> tuple[Joint, ...]:
    """Every frame but the bed, work side first, each side from the bed outward."""
    return (*_side(chain.work, "work", WORK), *_side(chain.tool, "tool", WHEEL))


def matrix(chain: Chain, frame: str, into: str, q: Positions, *, state: State = "actual") -> FloatArray:
    """T(into <- frame) at positions q (mm, rad), shape (..., 4, 4). Raises ModelError E-CHAIN-WORD."""
    if state not in STATES:
        raise ModelError("E-CHAIN-WORD", "chain", key="state", value=state, known=", ".join(STATES))
    ways = {one: _way(chain, one) for one in (frame, into)}
    shared = 0
    for first, second in zip(*ways.values(), strict=False) if frame != into else ():
        if first.frame != second.frame:
            break
        shared += 1
    if frame == into:
        return np.eye(4)
    there, here = (_product(ways[one][shared:], q, state) for one in (frame, into))
    back = np.linalg.inv(here) if state == "small-angle" else transforms.inverse(here)
    return np.asarray(back @ there)


def relative_errors(chain: Chain, q: Positions, frame: Frame = "work", order: RelativeOrder = "exact") -> FloatArray:
    """(dx, dy, dz, ea, eb, ec) of wheel to work at positions q, mm and rad, (..., 6).

    ``order`` "exact" is the logarithm of the exact motion, "first" the sum of all errors by their levers, and
    "small-angle" is read off the product of the linear matrices. Raises ModelError E-CHAIN-WORD.
    """
    if order not in RELATIVE_ORDERS:
        raise ModelError("E-CHAIN-WORD", "chain", key="order", value=order, known=", ".join(RELATIVE_ORDERS))
    if order == "exact":
        return chain.exact_twist(q, frame)
    if order == "first":
        return chain.twist(q, frame)
    actual, back = matrix(chain, WHEEL, WORK, q, state="small-angle"), transforms.inverse(chain.ideal(q))
    error = actual @ back if frame == "work" else back @ actual
    turning = 0.5 * (error[..., :3, :3] - np.swapaxes(error[..., :3, :3], -1, -2))
    angles = (turning[..., 2, 1], turning[..., 0, 2], turning[..., 1, 0])
    return np.concatenate([error[..., :3, 3], np.stack(angles, axis=-1)], axis=-1)


def with_relative(chain: Chain, name: str, size: float) -> Chain:
    """The perfect machine with one relative error of the wheel alone, told in the wheel (mm or rad): T_act = T_id E."""
    errors = Axis("relative", "prismatic", (0.0, 0.0, 1.0), err={name: size})
    clean = chain.without_errors()
    return Chain(clean.work, (*clean.tool, errors))


def _side(elements: tuple[Element, ...], side: Literal["work", "tool"], end: str) -> list[Joint]:
    found: list[Joint] = []
    parent = BED
    for number, element in enumerate(elements):
        last = number == len(elements) - 1 and not isinstance(element, Axis)
        name = element.name if isinstance(element, Axis) else end if last else f"{side} link {number + 1}"
        found.append(Joint(name, parent, side, element))
        parent = name
    return found if parent == end else [*found, Joint(end, parent, side, None)]


def _way(chain: Chain, frame: str) -> list[Joint]:
    """The joints from the bed to a frame. Raises ModelError E-CHAIN-WORD."""
    every = {one.frame: one for one in joints(chain)}
    if frame != BED and frame not in every:
        raise ModelError("E-CHAIN-WORD", "chain", key="frame", value=frame, known=", ".join((BED, *every)))
    way: list[Joint] = []
    while frame != BED:
        way.insert(0, every[frame])
        frame = every[frame].parent
    return way


def _product(way: list[Joint], q: Positions, state: State) -> FloatArray:
    T = np.eye(4)
    for one in way:
        if isinstance(one.element, Axis):
            at = position(q, one.element.name)
            if state == "small-angle":
                T = T @ one.element.small_angle(at)
            else:
                T = T @ (one.element.actual(at) if state == "actual" else one.element.ideal(at))
        elif one.element is not None:
            T = T @ one.element.matrix()
    return T


# ---- A chain from the plain mapping of a site or error file.

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
    work, tool = (_side_elements(data.get(side, ()), side) for side in SIDES)
    return Chain(work, tool)


def _side_elements(elements: object, side: str) -> tuple[Element, ...]:
    if not isinstance(elements, Sequence) or isinstance(elements, str):
        raise ModelError("E-CHAIN-ELEMENT", side, why=Message.of("W-MODEL-SIDE"))
    return tuple(_element(element, f"{side}[{number}]") for number, element in enumerate(elements))


def _element(data: object, where: str) -> Element:
    if not isinstance(data, Mapping):
        raise ModelError("E-CHAIN-ELEMENT", where, why=Message.of("W-MODEL-ELEMENT"))
    known = LINK_KEYS if data.get("kind") == "fixed" else AXIS_KEYS
    for key in data:
        if key not in known:
            raise ModelError("E-CHAIN-WORD", where, key="key", value=key, known=", ".join(known))
    if data.get("kind") == "fixed":
        return FixedLink(data.get("xyz", (0.0, 0.0, 0.0)), data.get("abc", (0.0, 0.0, 0.0)))
    for key in AXIS_KEYS[:3]:
        if key not in data:
            raise ModelError("E-CHAIN-ELEMENT", where, why=Message.of("W-MODEL-KEY-MISSING", key=key))
    for key in ("err", "loc"):
        if not isinstance(data.get(key, {}), Mapping):
            raise ModelError("E-CHAIN-ELEMENT", where, why=Message.of("W-MODEL-KEY-TABLE", key=key))
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
