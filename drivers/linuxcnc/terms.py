"""What LinuxCNC's documents call its tables, and what a person does."""

from __future__ import annotations

from drivers.terms import Coded, Terms

LINUXCNC = Terms(
    own="screw compensation",
    own_rule=Coded("S-TERM-TRIM-RULE"),
    own_side=Coded("S-TERM-TRIM-SIDE"),
    own_memory="COMP_FILE",
    own_reserve="COMP_FILE",
    backlash="BACKLASH",
    axis_name=Coded("S-TERM-LCNC-AXIS"),
    units=Coded("S-TERM-LCNC-UNITS"),
    words=Coded("S-TERM-LCNC-WORDS"),
    start="Cycle Start",
    restart="restart of LinuxCNC",
    version="LinuxCNC version",
    controls="LinuxCNC 2.9",
    suffixes=".comp",
    program_suffix=".ngc",
    tables_suffix=".comp",
)
