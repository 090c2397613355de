"""DisableOrder -> NC program text: one table is switched off, and nothing else is done.

No point and no parameter is written and no axis is moved by the program. It says that the table is off only when
its switches read so and nothing acts any more; M30 ends it either way, and nothing waits for an answer.
"""

from __future__ import annotations

from drivers.sinumerik.ncprogram import reversing
from drivers.sinumerik.ncprogram.heads import Head, headed, section
from drivers.sinumerik.ncprogram.measuring import PREPARE, Setting, check_names, phase_block, text_of, unless_aborted
from drivers.sinumerik.ncprogram.motion import number
from drivers.sinumerik.ncprogram.switching import NOTHING
from drivers.sinumerik.ncprogram.words import FAMILY, Phase, Word, program_path
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import DisableOrder

SETTLE_S = 0.5
_LEFT, _ON = "TF_LEFT", "TF_ON"
_STOPS = "press RESET: the table may be on or off; start the order again or look at its switch on the screen."


def disabling(order: DisableOrder, setting: Setting) -> str:
    """The whole program. Raises LocalProtocolError (E-PROGRAM-NAME)."""
    check_names(order.axis)
    words = setting.words
    out = [
        section("modal states, R words"),
        *PREPARE,
        *(f"{words.name(word)}=0" for word in (Word.COUNTER, Word.MISMATCHES, Word.RELEASE)),
    ]
    out += [f"{words.name(word)}={value}" for word, value in _identity(order, setting).items()]
    out += [
        section("the table off"),
        "STOPRE",
        unless_aborted(words, _LEFT),
        *(f"{switch}=0" for switch in switches(order)),
    ]
    out += ["NEWCONF", f"G4 F{number(SETTLE_S)}", "STOPRE"]
    out += [f"IF {switch}<>0 GOTOF {_ON}" for switch in switches(order)]
    if order.kind != "reversal":  # no public variable shows what is taken up
        out += [f"IF ABS({acting(order)})>{value_text(NOTHING)} GOTOF {_ON}"]
    out += [section("ways out")]
    for label, phase in (("", Phase.SWITCHED_OFF), (_ON, Phase.STILL_ON), (_LEFT, Phase.LEFT)):
        out += [f"{label}:"] if label else []
        out += ["STOPRE", phase_block(words, phase), "M30"]
    what = f"switch the {order.kind} table {order.index} of {order.axis} off, nothing else"
    also = f"Switching the table off moves {order.axis} by the table's value."
    path = program_path("OFF", order.axis)
    return text_of(headed(Head(path, what, stops=_STOPS, origin=setting.origin, also=also), out))


def switches(order: DisableOrder) -> tuple[str, ...]:
    """The variables that put the table to work, in the order of switching off."""
    if order.kind == "reversal":
        return (reversing.datum(order.index, order.axis),)
    if order.kind == "axis":
        return (f"$MA_ENC_COMP_ENABLE[{order.index},{order.axis}]",)
    return (f"$SN_CEC_TABLE_ENABLE[{order.index}]", f"$MA_CEC_ENABLE[{order.axis}]")


def acting(order: DisableOrder) -> str:
    """The system variable that shows what acts on the axis."""
    return (
        f"$VA_ENC{order.index + 1}_COMP_VAL[{order.axis}]"
        if order.kind == "axis"
        else (f"$VA_CEC_COMP_VAL[{order.axis}]")
    )


def _identity(order: DisableOrder, setting: Setting) -> dict[Word, int]:
    return {
        Word.TRANSACTION: order.transaction,
        Word.TABLE: FAMILY[order.kind] + order.index,
        Word.AXIS: setting.axis_number,
        Word.POINTS: 0,
    }
