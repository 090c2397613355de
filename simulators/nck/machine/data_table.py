"""The machine and setting data the double knows: their names, kinds, limits, and when a change acts.

Numbers and meanings: MD texts of the vendor's data lists. Limits, defaults, activation classes and protection
levels are recalled values where the lists are not public.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

Effect = Literal["now", "newconf", "reset", "power_on", "never"]
Datum = bool | int | float | str

INCH_MM = 25.4


@dataclass(frozen=True, slots=True)
class DataSpec:
    """One datum. ``shape``: "" single, "n" array, "a" per axis, "na" array per axis; ``count`` for the n.

    ``length``: for a linear axis the number is a length (or a velocity) in the basic system of units.
    """

    shape: str
    kind: Literal["bool", "int", "real", "text"]
    effect: Effect
    default: Datum = 0
    low: float = -math.inf
    high: float = math.inf
    count: int = 1
    level: int = 2
    length: bool = False


def _real(shape: str, default: float = 0.0, low: float = -math.inf, high: float = math.inf) -> DataSpec:
    return DataSpec(shape, "real", "newconf", default, low=low, high=high, count=2 if shape == "na" else 1)


def _length(shape: str, default: float = 0.0, low: float = -math.inf, high: float = math.inf) -> DataSpec:
    return replace(_real(shape, default, low, high), length=True)


def _setting(shape: str, kind: Literal["bool", "real"], default: float = 0.0) -> DataSpec:
    return DataSpec(shape, kind, "now", default, level=7)


BACKLASH = "$MA_BACKLASH"
ENC_ENABLE = "$MA_ENC_COMP_ENABLE"
CEC_ENABLE = "$MA_CEC_ENABLE"
EEC_POINTS = "$MA_MM_ENC_COMP_MAX_POINTS"
QEC_POINTS = "$MA_MM_QEC_MAX_POINTS"
CEC_POINTS = "$MN_MM_CEC_MAX_POINTS"
SAVED_SETTINGS = "$MN_PROG_SD_RESET_SAVE_TAB"
IS_METRIC = "$MN_SCALING_SYSTEM_IS_METRIC"
ENC_STATE = "$MA_ENC_REFP_STATE"
LAYOUT = (EEC_POINTS, QEC_POINTS, CEC_POINTS)
"""Data that lay out buffered memory: a change loses what is in it at the next boot (MD38000, 38010, 18342)."""
SCALING = (IS_METRIC, "$MN_CONVERT_SCALING_SYSTEM")

DATA: dict[str, DataSpec] = {
    ENC_ENABLE: DataSpec("na", "bool", "newconf", False, count=2),
    CEC_ENABLE: DataSpec("a", "bool", "newconf", False),
    BACKLASH: _length("na"),
    "$MA_BACKLASH_FACTOR": DataSpec("na", "real", "newconf", 1.0, low=0.01, high=100.0, count=6),
    "$MA_BACKLASH_MODE": DataSpec("na", "int", "newconf", 0, low=0, high=3, count=2),
    "$MA_BACKLASH_DYN": _length("na"),
    "$MA_BACKLASH_DYN_MAX_VELO": _real("a", 1.0, 0.0, 100.0),
    "$MA_ENC_CHANGE_TOL": _length("a", 0.1, 0.0),
    "$MA_NUM_ENCS": DataSpec("a", "int", "power_on", 2, low=0, high=2),
    ENC_STATE: DataSpec("na", "int", "now", 0, low=0, high=2, count=2, level=4),
    "$MA_REFP_CYCLE_NR": DataSpec("a", "int", "newconf", 1, low=-1, high=31),
    "$MA_CEC_MAX_SUM": _length("a", 1.0, 0.0, 10.0),
    "$MA_CEC_MAX_VELO": _real("a", 10.0, 0.0, 100.0),
    "$MA_CEC_SCALING_SYSTEM_METRIC": DataSpec("a", "bool", "power_on", True),
    "$MA_TEMP_COMP_TYPE": DataSpec("a", "int", "newconf", 0, low=0, high=7),
    "$MA_COMP_ADD_VELO_FACTOR": _real("a", 0.01, 0.0, 0.1),
    "$MA_MAX_AX_VELO": _length("a", 10000.0, 1e-6),
    "$MA_POS_LIMIT_PLUS": _length("a", 1e8),
    "$MA_POS_LIMIT_MINUS": _length("a", -1e8),
    "$MA_REFP_SET_POS": DataSpec("na", "real", "newconf", 0.0, count=4, length=True),
    "$MA_IS_ROT_AX": DataSpec("a", "bool", "never", False),
    "$MA_ROT_IS_MODULO": DataSpec("a", "bool", "never", False),
    EEC_POINTS: DataSpec("na", "int", "power_on", 0, low=0, high=5000, count=2),
    QEC_POINTS: DataSpec("na", "int", "power_on", 0, low=0, high=1040, count=2),
    CEC_POINTS: DataSpec("n", "int", "power_on", 0, low=0, high=2000),
    IS_METRIC: DataSpec("", "bool", "power_on", True),
    "$MN_CONVERT_SCALING_SYSTEM": DataSpec("", "bool", "power_on", False),
    "$MN_AXCONF_MACHAX_NAME_TAB": DataSpec("n", "text", "never", ""),
    "$MN_HW_SERIAL_NUMBER": DataSpec("n", "text", "never", "", count=2),
    "$MN_VERSION_INFO": DataSpec("n", "text", "never", "", count=4),
    "$MN_INFO_FREE_MEM_STATIC": DataSpec("", "int", "never", 1_000_000),
    "$MN_LEN_PROTOCOL_FILE": DataSpec("", "int", "now", 1, low=1, high=100000),
    "$MN_PROTOCOL_FILE_MODE": DataSpec("", "int", "now", 0, low=0, high=1),
    SAVED_SETTINGS: DataSpec("n", "int", "reset", 0, low=0, high=50000, count=10),
    "$MC_DIAMETER_AX_DEF": DataSpec("", "text", "never", ""),
    "$MN_INI_FILE_MODE": DataSpec("", "int", "now", 1, low=0, high=2),
    "$MN_MD_FILE_STYLE": DataSpec("", "int", "now", 3, low=0, high=31),
    "$MC_REFP_NC_START_LOCK": DataSpec("", "int", "reset", 1, low=0, high=2),
    "$SN_CEC_TABLE_ENABLE": _setting("n", "bool"),
    "$SN_CEC_TABLE_WEIGHT": _setting("n", "real", 1.0),
    "$SN_CEC_0": _setting("n", "real"),
    "$SN_CEC_1": _setting("n", "real"),
    "$SN_CEC_BAS_0": _setting("n", "real"),
    "$SN_CEC_BAS_1": _setting("n", "real"),
    "$SN_CEC_BAS_STORE_0": _setting("n", "real"),
    "$SN_CEC_BAS_STORE_1": _setting("n", "real"),
    "$SN_CEC_COMP_0": _setting("n", "real"),
    "$SN_CEC_COMP_1": _setting("n", "real"),
    "$SN_CEC_COMP_STORE_0": _setting("n", "real"),
    "$SN_CEC_COMP_STORE_1": _setting("n", "real"),
    "$SN_CEC_CALC": _setting("n", "bool"),
    "$SN_CEC_CALC_ADD": _setting("n", "bool"),
    "$SA_TEMP_COMP_ABS_VALUE": replace(_setting("a", "real"), length=True),
    "$SA_TEMP_COMP_SLOPE": _setting("a", "real"),
    "$SA_TEMP_COMP_REF_POSITION": replace(_setting("a", "real"), length=True),
}
