"""Every variable that a compensation file may assign to: shapes of its indices and value, limits, machine data number.

Names, types and numbers: SINUMERIK 840D sl system variables (EEC, CEC) and machine and setting data descriptions
(32450-32457 backlash, 32750/32760 and 43900-43920 temperature, 32700-32730 and 41300/41310 switches and limits).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Shape = Literal["value", "position", "integer", "flag", "axis", "name"]


@dataclass(frozen=True, slots=True)
class Variable:
    """``indices``: "n" for each number, "a" for an axis. ``first_below`` bounds the first number (0 based).

    ``low``, ``high`` bound the value; ``number`` is that of the machine or setting datum, 0 for table variables;
    ``length``: a setting in the axis' own unit; ``fact``: it says what the machine is and compensates nothing.
    """

    indices: str
    shape: Shape
    number: int = 0
    first_below: int = 1_000_000
    low: float = -100_000.0
    high: float = 100_000.0
    length: bool = False
    fact: bool = False


ENCODERS = 2
AXES = 99  # machine axes are called AX1 to AX31, with link axes more; AX0 is none
TABLES = 1000  # twice the axes of the control; nobody has more

VARIABLES: dict[str, Variable] = {
    "$AA_ENC_COMP": Variable("nna", "value", first_below=ENCODERS),
    "$AA_ENC_COMP_STEP": Variable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MIN": Variable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MAX": Variable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_IS_MODULO": Variable("na", "flag", first_below=ENCODERS),
    "$AN_CEC": Variable("nn", "value", first_below=TABLES),
    "$AN_CEC_INPUT_AXIS": Variable("n", "axis", first_below=TABLES),
    "$AN_CEC_OUTPUT_AXIS": Variable("n", "axis", first_below=TABLES),
    "$AN_CEC_INPUT_NCU": Variable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_OUTPUT_NCU": Variable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_STEP": Variable("n", "position", first_below=TABLES),
    "$AN_CEC_MIN": Variable("n", "position", first_below=TABLES),
    "$AN_CEC_MAX": Variable("n", "position", first_below=TABLES),
    "$AN_CEC_DIRECTION": Variable("n", "integer", first_below=TABLES, low=-1, high=1),
    "$AN_CEC_MULT_BY_TABLE": Variable("n", "integer", first_below=TABLES, low=0, high=TABLES),
    "$AN_CEC_IS_MODULO": Variable("n", "flag", first_below=TABLES),
    "$AN_CEC_TYPE": Variable("n", "integer", first_below=TABLES, low=0, high=1),
    "$MA_ENC_COMP_ENABLE": Variable("na", "flag", 32700, ENCODERS),
    "$MA_CEC_ENABLE": Variable("a", "flag", 32710),
    "$MA_CEC_MAX_SUM": Variable("a", "value", 32720, low=0, length=True),
    "$MA_CEC_MAX_VELO": Variable("a", "value", 32730, low=0),
    "$SN_CEC_TABLE_ENABLE": Variable("n", "flag", 41300, TABLES),
    "$SN_CEC_TABLE_WEIGHT": Variable("n", "value", 41310, TABLES),
    "$MA_BACKLASH": Variable("na", "value", 32450, ENCODERS, length=True),
    "$MA_BACKLASH_FACTOR": Variable("na", "value", 32452, 6, low=0.01, high=100),
    "$MA_BACKLASH_MODE": Variable("na", "integer", 32454, ENCODERS, low=0, high=255),
    "$MA_BACKLASH_DYN": Variable("na", "value", 32456, ENCODERS, length=True),
    "$MA_BACKLASH_DYN_MAX_VELO": Variable("a", "value", 32457, low=0, high=100),
    "$MA_TEMP_COMP_TYPE": Variable("a", "integer", 32750, low=0, high=7),
    "$MA_COMP_ADD_VELO_FACTOR": Variable("a", "value", 32760, low=0, high=1),
    "$SA_TEMP_COMP_ABS_VALUE": Variable("a", "value", 43900, length=True),
    "$SA_TEMP_COMP_SLOPE": Variable("a", "value", 43910),
    "$SA_TEMP_COMP_REF_POSITION": Variable("a", "position", 43920, length=True),
    "$MN_AXCONF_MACHAX_NAME_TAB": Variable("n", "name", 10000, AXES, fact=True),
    "$MN_MM_CEC_MAX_POINTS": Variable("n", "integer", 18342, TABLES, low=0, fact=True),
    "$MA_NUM_ENCS": Variable("a", "integer", 30200, low=0, high=ENCODERS, fact=True),
    "$MA_IS_ROT_AX": Variable("a", "flag", 30300, fact=True),
    "$MA_MM_ENC_COMP_MAX_POINTS": Variable("na", "integer", 38000, ENCODERS, low=0, fact=True),
}
