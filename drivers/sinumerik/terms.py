"""What a SINUMERIK's manuals call the two kinds of tables, their memory and the acts of a person."""

from __future__ import annotations

from drivers.terms import Coded, Terms

SINUMERIK = Terms(
    own="EEC",
    cross="CEC",
    own_key="eec",
    cross_key="cec",
    own_rule=Coded("S-TERM-EEC-RULE"),
    own_side=Coded("S-TERM-EEC-SIDE"),
    cross_rule=Coded("S-TERM-CEC-RULE"),
    reversal="backlash value (MD32450)",
    reversal_rule=Coded("S-TERM-MD32450-RULE"),
    sign_doubt=Coded("S-TERM-CEC-DOUBT"),
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
    cross_off=Coded("S-TERM-CEC-OFF"),
    words="R parameters",
    start="NC START",
    restart="NCK reset",
    version="NCK version",
    serial="MD18030",
    controls="840D, 828D, 808D or 802D",
    suffixes=".spf, .mpf, .ini, .arc",
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
