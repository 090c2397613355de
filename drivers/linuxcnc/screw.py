"""A joint's screw file and what it means: rows to a table of deviations, and back; pure.

Where a file has no row, BACKLASH of the INI file acts in its place: half of it in each direction. With rows the kernel
leaves BACKLASH out (`compute_screw_comp` in src/emc/motion/control.c).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.errors import TableError, TooManyPoints
from drivers.exchange.linuxcnc import MOST_ROWS, LinuxCncScrew
from drivers.types.exchange import ReadAs
from drivers.types.identity import MachineIdentity
from drivers.types.tables import CompensationTable, LiveSet, LiveTable, reversal_of
from drivers.units import AxisUnit, deviation_scale

EMPTY = "# no compensation\n"
FORMS = {0: "positions", 1: "trims"}
_EVEN = 1e-7


def machine_of(said: Mapping[str, Any]) -> MachineIdentity:
    """The fingerprint from an agent's answer: names of the INI file and of the host, version, letters of all joints."""
    letters = tuple(joint["letter"] for joint in said["joints"])
    return MachineIdentity(f"{said['machine']}-{said['name']}", said["version"], letters)


def unit_of(joint: Mapping[str, Any]) -> AxisUnit:
    """Unit of a joint as the agent describes it."""
    return "deg" if joint["rotary"] else "mm"


def text_of(table: CompensationTable, joint: Mapping[str, Any]) -> str:
    """The file of a table, in the form that COMP_FILE_TYPE says.

    Raises TableError (E-LCNC-TABLE), TooManyPoints (E-COMP-POINTS): the kernel would cut the rest and run on.
    """
    if table.kind != "axis" or table.input_axis != table.output_axis:
        raise TableError("E-LCNC-TABLE", table.name, axis=table.output_axis)
    count = len(table.deviations)
    if count > MOST_ROWS:
        raise TooManyPoints("E-COMP-POINTS", table.name, needed=count, reserved=MOST_ROWS, memory="COMP_FILE")
    return LinuxCncScrew().text((table,), FORMS[joint["type"]], ())


def off_text(joint: Mapping[str, Any]) -> str:
    """The file that corrects nothing. Without rows BACKLASH acts, so where there is one it has two rows of no trim."""
    if not joint["backlash"]:
        return EMPTY
    ends = (joint["minimum"], joint["maximum"])
    rows = [f"{end:.6f} {end:.6f} {end:.6f}" if joint["type"] == 0 else f"{end:.6f} 0 0" for end in ends]
    return "\n".join(rows) + f"\n{EMPTY}"


def _is_off(text: str) -> bool:
    """Whether it is a file of `off_text`: what its rows hold is for the kernel, and no table."""
    return text.endswith(EMPTY)


def _has_rows(text: str) -> bool:
    return bool(text.strip()) and not text.lstrip().startswith("#")


def _own(text: str, joint: Mapping[str, Any], where: str) -> LiveTable:
    letter, unit = joint["letter"], unit_of(joint)
    if _has_rows(text) and not _is_off(text):
        (table,) = LinuxCncScrew().read(text, where, ReadAs(letter, unit, FORMS[joint["type"]]))
        return LiveTable(_even(table), enabled=True)
    half = 0.0 if _is_off(text) and text != EMPTY else joint["backlash"] / 2.0 * deviation_scale(unit)
    nothing = replace(reversal_of(letter, unit, 0.0), kind="axis")
    if not half:
        return LiveTable(nothing, enabled=False)
    low, high = joint["minimum"], joint["maximum"]
    both = replace(nothing, minimum=low, maximum=high, step=high - low, deviations=(-half, -half), reverse=(half, half))
    return LiveTable(both, enabled=True)


def _even(table: CompensationTable) -> CompensationTable:
    """Points of equal step are said as such, as those who work with tables ask for them."""
    step = (table.maximum - table.minimum) / (len(table.places) - 1)
    even = table.minimum + step * np.arange(len(table.places))
    if np.abs(even - table.positions).max() > _EVEN:
        return table
    return replace(table, step=round(step, 9), places=())


def live_of(text: str, joint: Mapping[str, Any], where: str, *, enabled: bool = True) -> LiveSet:
    """What a file makes the kernel do. Raises FileFormatError (E-EXCHANGE-...) with the line."""
    own = _own(text, joint, where)
    told = f"{joint['type']} {joint['backlash']!r}\n{text if _has_rows(text) else ''}"
    digest = hashlib.sha256(told.encode()).hexdigest()
    own = LiveTable(own.table, own.enabled and enabled)
    return LiveSet(joint["letter"], own, (), backlash=0.0, native=text, digest=digest)
