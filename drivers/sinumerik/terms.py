"""What a SINUMERIK's manuals call the two kinds of tables, their memory and the acts of a person."""

from __future__ import annotations

from drivers.terms import Terms

SINUMERIK = Terms(
    own="EEC",
    cross="CEC",
    own_key="eec",
    cross_key="cec",
    own_rule="EEC acts on the actual side: a positive stored value moves the axis in the negative direction",
    own_side="The encoder error compensation (EEC) acts on the actual value: a positive value moves the axis in the "
    "negative direction.",
    cross_rule="CEC acts on the setpoint side; its sense is not taken from a manual but measured",
    reversal="backlash value (MD32450)",
    reversal_rule="MD32450 is taken up at every reversal: positive where the encoder leads the machine part (B < 0)",
    sign_doubt="CEC SIGN UNPROVEN: values follow the EEC convention (value = +deviation)",
    own_memory="MD38000 $MA_MM_ENC_COMP_MAX_POINTS",
    cross_memory="MD18342 $MN_MM_CEC_MAX_POINTS",
    own_reserve="MD38000",
    cross_reserve="MD18342",
    backlash="MD32450",
    product="$AN_CEC_MULT_BY_TABLE",
    axis_name="MD10000",
    units="MD10240",
    senses="MD32110/MD32100",
    cross_sum="MD32720",
    cross_type="$AN_CEC_TYPE",
    cross_off="(SD41300 $SN_CEC_TABLE_ENABLE = 0 of these tables, NEWCONF)",
    words="R parameters",
    start="NC START",
    restart="NCK reset",
    version="NCK version",
    serial="MD18030",
    controls="840D, 828D, 808D or 802D",
    suffixes=".spf, .mpf, .ini or .arc",
    program_suffix=".mpf",
    tables_suffix=".spf",
    older={
        "function": "kind",
        "EEC": "axis",
        "CEC": "cross",
        "eec": "own",
        "cec": "cross",
        "with_eec": "with_own",
        "nck_version": "version",
    },
)
