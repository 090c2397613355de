"""DwellPlan -> NC program text for a capture program of somebody else, which triggers when the axis stands still.

The program shakes no hands: it uses no R parameter, writes nothing and waits at each target. At the first target,
which it reaches from that stop's own side, it waits (M0): there the person zeroes the laser and starts the capture, so
every reading counts from where the axis really stands. The order of stops is that of a measuring run: each target in
both directions, with overrun at each end.
"""

from __future__ import annotations

from drivers.errors import LocalProtocolError
from drivers.programs import DwellPlan, Origin
from drivers.sinumerik.ncprogram import looping
from drivers.sinumerik.ncprogram.heads import Head, headed, section
from drivers.sinumerik.ncprogram.measuring import PREPARE, check_names, text_of
from drivers.sinumerik.ncprogram.motion import Motion, number
from drivers.sinumerik.ncprogram.words import program_path

ABOUT = "a capture program that triggers by itself"
STOPPED = "press RESET: it has written nothing. Begin the capture anew."
READY = "AT THE FIRST TARGET: ZERO THE LASER, START THE CAPTURE, PRESS NC START"


def dwelling(plan: DwellPlan, modulo: bool, origin: Origin, *, loops: bool = True) -> str:
    """The program: one loop over a table of its targets, or every move written out where ``loops`` is not known.

    Raises LocalProtocolError (E-PROGRAM-NAME, E-PROGRAM-EMPTY, E-PROGRAM-SIZE)."""
    stops = plan.stops
    check_names(stops.axis, stops.letter, stops.axis)
    if not stops.stops:
        raise LocalProtocolError("E-PROGRAM-EMPTY", stops.name)
    motion = Motion(stops.letter, modulo, stops.feed, stops.overrun)
    legs = list(motion.legs(stops.stops))
    ready, dwells = [f'MSG("{READY}")', "M0", 'MSG("")'], f"G4 F{number(plan.dwell_s)}"
    table = looping.visits(stops.stops, motion) if loops and len(stops.stops) > 1 else None
    out = [section("modal states"), *PREPARE]
    if table is not None and looping.fits(table.arrays):
        first = f"IF ({looping.PASS}==0) AND ({looping.STEP}==1)"
        out = [f"DEF INT {looping.COUNTERS}", *looping.declared(table.arrays), *out]
        out += table.around([first, *ready, "ENDIF", dwells])
    else:
        out += [section("to the first target, from its own side"), *legs[0], *ready, section("targets"), dwells]
        out += [block for leg in legs[1:] for block in (*leg, dwells)]
    out.append("M30")
    what = f"{len(stops.stops)} stops of {stops.axis} for {ABOUT}, {plan.dwell_s:g} s at each"
    moves = [block for leg in legs for block in leg]
    return text_of(headed(Head(program_path("DWEL", stops.axis), what, stops=STOPPED, origin=origin), out, moves=moves))
