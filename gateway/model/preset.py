"""The YK7350B form grinder: X carries the C table with the work, Z carries the wheel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from gateway.model.axis import Axis, Motion
from gateway.model.chain import LETTERS, Chain

MOTION_NAMES = tuple(f"E{letter}{axis}" for axis in "XZC" for letter in LETTERS)
LOCATION_NAMES = ("B0Z", "A0C", "B0C")
TWENTY_ONE = (*MOTION_NAMES, *LOCATION_NAMES)


def yk7350b(
    errors: Mapping[str, Motion] | None = None,
    *,
    c_frame: Literal["moving", "fixed"] = "moving",
    x_direction: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Chain:
    """The machine of the paper: bed > X > C (work) and bed > Z (wheel, axis Y), T_WT = Rz(-c) trans(-x, 0, z).

    ``errors`` by ISO 230-1 name in mm and rad (`TWENTY_ONE` and every other location error); ``c_frame`` says
    in which frame the C errors were measured: "fixed" for artefact and spindle analysis. With ``x_direction``
    (-1, 0, 0) the X command counts the centre distance upward.
    """
    x = Axis("X", "prismatic", x_direction)
    c = Axis("C", "revolute", (0.0, 0.0, 1.0), err_frame=c_frame)
    z = Axis("Z", "prismatic", (0.0, 0.0, 1.0))
    return Chain((x, c), (z,)).with_errors(errors or {})
