"""Every variable that a compensation file may assign to: shapes of its indices and value, limits, machine data number.

Names, types and numbers: SINUMERIK 840D sl system variables (EEC, CEC) and machine and setting data descriptions
(32450-32457 backlash, 32750/32760 and 43900-43920 temperature, 32700-32730 and 41300/41310 switches and limits).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Shape = Literal["value", "position", "integer", "flag", "axis", "name"]


@dataclass(frozen=True, slots=True)
class TableVariable:
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

VARIABLES: dict[str, TableVariable] = {
    "$AA_ENC_COMP": TableVariable("nna", "value", first_below=ENCODERS),
    "$AA_ENC_COMP_STEP": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MIN": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MAX": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_IS_MODULO": TableVariable("na", "flag", first_below=ENCODERS),
    "$AN_CEC": TableVariable("nn", "value", first_below=TABLES),
    "$AN_CEC_INPUT_AXIS": TableVariable("n", "axis", first_below=TABLES),
    "$AN_CEC_OUTPUT_AXIS": TableVariable("n", "axis", first_below=TABLES),
    "$AN_CEC_INPUT_NCU": TableVariable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_OUTPUT_NCU": TableVariable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_STEP": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_MIN": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_MAX": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_DIRECTION": TableVariable("n", "integer", first_below=TABLES, low=-1, high=1),
    "$AN_CEC_MULT_BY_TABLE": TableVariable("n", "integer", first_below=TABLES, low=0, high=TABLES),
    "$AN_CEC_IS_MODULO": TableVariable("n", "flag", first_below=TABLES),
    "$AN_CEC_TYPE": TableVariable("n", "integer", first_below=TABLES, low=0, high=1),
    "$MA_ENC_COMP_ENABLE": TableVariable("na", "flag", 32700, ENCODERS),
    "$MA_CEC_ENABLE": TableVariable("a", "flag", 32710),
    "$MA_CEC_MAX_SUM": TableVariable("a", "value", 32720, low=0, length=True),
    "$MA_CEC_MAX_VELO": TableVariable("a", "value", 32730, low=0),
    "$SN_CEC_TABLE_ENABLE": TableVariable("n", "flag", 41300, TABLES),
    "$SN_CEC_TABLE_WEIGHT": TableVariable("n", "value", 41310, TABLES),
    "$MA_BACKLASH": TableVariable("na", "value", 32450, ENCODERS, length=True),
    "$MA_BACKLASH_FACTOR": TableVariable("na", "value", 32452, 6, low=0.01, high=100),
    "$MA_BACKLASH_MODE": TableVariable("na", "integer", 32454, ENCODERS, low=0, high=255),
    "$MA_BACKLASH_DYN": TableVariable("na", "value", 32456, ENCODERS, length=True),
    "$MA_BACKLASH_DYN_MAX_VELO": TableVariable("a", "value", 32457, low=0, high=100),
    "$MA_TEMP_COMP_TYPE": TableVariable("a", "integer", 32750, low=0, high=7),
    "$MA_COMP_ADD_VELO_FACTOR": TableVariable("a", "value", 32760, low=0, high=1),
    "$SA_TEMP_COMP_ABS_VALUE": TableVariable("a", "value", 43900, length=True),
    "$SA_TEMP_COMP_SLOPE": TableVariable("a", "value", 43910),
    "$SA_TEMP_COMP_REF_POSITION": TableVariable("a", "position", 43920, length=True),
    "$MN_AXCONF_MACHAX_NAME_TAB": TableVariable("n", "name", 10000, AXES, fact=True),
    "$MN_MM_CEC_MAX_POINTS": TableVariable("n", "integer", 18342, TABLES, low=0, fact=True),
    "$MA_NUM_ENCS": TableVariable("a", "integer", 30200, low=0, high=ENCODERS, fact=True),
    "$MA_IS_ROT_AX": TableVariable("a", "flag", 30300, fact=True),
    "$MA_MM_ENC_COMP_MAX_POINTS": TableVariable("na", "integer", 38000, ENCODERS, low=0, fact=True),
}
