"""What no public document settles, and how a hostile control behaves: every switch of the simulator in one place.

The simulator is written from manuals; where these are silent it can be set either way, so that whoever talks to
it must work whichever way the real control turns out to be. Those in `OPEN` may be drawn by a seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Activation = Literal["newconf", "nck_reset", "power_on"]
Choice = bool | int | str
HmiWrite = tuple[str, float]


OPEN: dict[str, tuple[Choice, ...]] = {
    "cec_sign": (1, -1),
    "cec_factor_tables_count": (False, True),
    "cec_direction_at_start": (1, 0, -1),
    "cec_direction_at_standstill": (True, False),
    "activation": ("nck_reset", "newconf", "power_on"),
    "locked_alarm": (17070, 17180),
    "fetch_while_waiting": (True, False),
    "r_writable": (True, False),
    "backlash_reacts_to_cec": (True, False),
    "backlash_sign": (1, -1),
    "backlash_activation": ("newconf", "nck_reset"),
    "shortened_max_is_stored": (False, True),
    "enable_cleared_at_boot": (False, True),
    "encoder_lead_shared": (True, False),
    "system_reads_stop": (False, True),
    "modal_stays": (False, True),
    "fills_arrays": (True, False),
    "uneven_step": ("floor", "stretched", "ceil", "idle"),
}
"""The open switches and what each can be, the default first; a seed may draw one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Switches:
    """The open questions, the habits that a control may have, and what happens at a block.

    Not settled publicly
        ``cec_sign`` +1: as EEC, a positive value moves the axis negative; -1: the other way.
        ``cec_factor_tables_count``: with MULT_BY_TABLE both factors' own outputs count besides the product.
        ``cec_direction_at_start``: what DIRECTION +1/-1 tables take for the direction before the base axis's
        first move after power on; 0: neither kind acts until then.
        ``cec_direction_at_standstill``: False: they act only while the base axis travels.
        ``activation``: when changed table content begins to act: at NEWCONF (or channel reset), at an NCK
        reset or a power cycle, or at a power cycle alone. ``strict_activation`` False means "newconf".
        ``locked_alarm``: the alarm when an enabled table is written.
        ``fetch_while_waiting``: files may be read from outside while a program runs or waits.
        ``r_writable``: R parameters may be written from outside.
        ``fills_arrays``: programs may fill arrays of their own by SET and REP; False: alarm 12550 at such a block.
        ``modal_stays``: modal states (plane, inch, diameter, frames, transformation...) outlive the end of a program;
        False: each begins with the control's own. ``diameter_axis``: letter of the axis that DIAMON counts in
        diameters; ``zero_offset_mm`` what G54 to G599 shift linear axes by; ``tool_length_mm`` of D1, along the third
        axis of the plane.
        ``judges_programs``: what the printed rules of the language refuse is not run (alarm 12080); False only
        where the interpreter behind that gate is tried by itself.
        ``backlash_sign`` -1: MD32450 acts the other way than its text says. ``backlash_activation`` "nck_reset": a new
        value acts only from the next start on, whatever its class says.
        ``backlash_reacts_to_cec``: False: as if MD32454 bit 1 were always set.
        ``shortened_max_is_stored``: where memory ends before MAX, _MAX reads back shortened once it acts.
        ``enable_cleared_at_boot``: MD32700 and MD32710 are 0 after an NCK reset or power on.
        ``uneven_step``: a STEP that does not divide MAX - MIN. "floor": the last point is k = floor((MAX - MIN) / STEP)
        and its value holds from there on; "stretched": that point stands at MAX; "ceil": the next point acts too;
        "idle": the table does nothing.
        ``encoder_lead_shared``: True: backlash is taken up by half in each direction; False: all of it in -.

    Preprocessing
        ``preprocess_ahead``: blocks of motion, dwell, message or stop the interpreter may be ahead of the
        machine; everything else takes effect when it is interpreted, unless STOPRE stands before it.
        0: strictly in sequence, as if every block had a STOPRE.
        ``system_reads_stop``: reading a ``$AA_``, ``$VA_`` or ``$AC_`` variable stops preprocessing by itself.

    Hostile
        ``lies_about_disable``: MD32700 reads 0, tables can be written, but the compensation goes on until the
        next NCK reset. ``ignores_newconf``: NEWCONF in a program does nothing; reset does.
        ``float32_tables``: table values are kept in single precision. ``accepts_nan``: and take NaN.
        ``accepts_points_beyond``: a point beyond the reserved memory is swallowed without 17030.
        ``loses_last_points``: that many points at the table's end (MAX) are never stored, without alarm.
        ``writes_late_s``: a table value reads, and acts, as before until that many seconds after the write.
        ``stale_files``: a file that was replaced is still read from outside as it was before.
        ``reads_another_axis``: ``$AA_ENC_COMP`` of an axis shows the next axis that has a table.

        ``swaps_points_at_reset``: at every start but the first, before tables are taken over, point n of every
        table and the next are exchanged. ``enables_again_s``: what was switched on is switched on once more that
        many s later, whatever was done to it since.

    Who it is
        ``card_exchanged``: the card's number (MD18030) is this one, as after service. ``software_updated``: so is the
        version. ``hardware_exchanged``: and the number for its type. ``axes_swapped``: the last two machine axes have
        each other's number. The site's own marker goes with ``forgets`` "words".

    At block k of a program (counted from 1 at NC START, with all subprograms; once for each control)
        ``power_cut_at_block``: the mains fail when block k is done. ``alarm_at_block``: the drive reports
        alarm ``block_alarm`` and the program stops. ``keyswitch_at_block``: somebody turns the key switch to
        ``block_access_level``. ``mode_change_at_block``: somebody stops, resets and chooses JOG.
        ``hmi_writes_at_block``: somebody at the HMI with service rights writes ``hmi_writes``, pairs of name
        and value in order; what the control refuses is refused to him as well. ``enables_at_block``: the control
        switches every table that was ever loaded on, by itself. ``forgets_at_block``: it forgets what ``forgets``
        says: "words" (R parameters), "memory" (points of tables) or "switch".
    """

    cec_sign: int = 1
    cec_factor_tables_count: bool = False
    cec_direction_at_start: int = 1
    cec_direction_at_standstill: bool = True
    activation: Activation = "nck_reset"
    strict_activation: bool = True
    locked_alarm: int = 17070
    fetch_while_waiting: bool = True
    r_writable: bool = True
    judges_programs: bool = True
    fills_arrays: bool = True
    modal_stays: bool = False
    diameter_axis: str = ""
    zero_offset_mm: float = 0.0
    tool_length_mm: float = 0.0
    backlash_reacts_to_cec: bool = True
    backlash_sign: int = 1
    backlash_activation: str = "newconf"
    shortened_max_is_stored: bool = False
    enable_cleared_at_boot: bool = False
    encoder_lead_shared: bool = True
    uneven_step: str = "floor"
    preprocess_ahead: int = 20
    system_reads_stop: bool = False
    lies_about_disable: bool = False
    ignores_newconf: bool = False
    float32_tables: bool = False
    accepts_nan: bool = False
    accepts_points_beyond: bool = False
    loses_last_points: int = 0
    writes_late_s: float = 0.0
    stale_files: bool = False
    reads_another_axis: bool = False
    swaps_points_at_reset: int | None = None
    enables_again_s: float = 0.0
    card_exchanged: str = ""
    software_updated: str = ""
    hardware_exchanged: float = 0.0
    axes_swapped: bool = False
    power_cut_at_block: int | None = None
    alarm_at_block: int | None = None
    block_alarm: int = 300504
    keyswitch_at_block: int | None = None
    block_access_level: int = 7
    mode_change_at_block: int | None = None
    hmi_writes_at_block: int | None = None
    hmi_writes: tuple[HmiWrite, ...] = ()
    enables_at_block: int | None = None
    forgets_at_block: int | None = None
    forgets: Literal["words", "memory", "switch"] = "switch"

    @property
    def acts_from(self) -> Activation:
        """When changed table content begins to act."""
        return self.activation if self.strict_activation else "newconf"

    def checked(self) -> None:
        """Raises ValueError for a value that means nothing."""
        for name, choices in OPEN.items():
            if getattr(self, name) not in choices and name != "locked_alarm":
                raise ValueError(f"{name} is one of {', '.join(map(str, choices))}")
        if self.forgets not in ("words", "memory", "switch"):
            raise ValueError("forgets is one of words, memory, switch")
        least = min(self.preprocess_ahead, self.loses_last_points, self.writes_late_s, self.enables_again_s)
        if least < 0.0:
            raise ValueError("preprocess_ahead, loses_last_points, writes_late_s and enables_again_s are not negative")
