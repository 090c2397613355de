"""What LinuxCNC's documents call its tables, and what a person does."""

from __future__ import annotations

from drivers.terms import Terms

LINUXCNC = Terms(
    own="screw compensation",
    own_rule="a positive trim in the file moves the joint in the positive direction: trim = -deviation",
    own_side="The trim of COMP_FILE is added to the position that the motor is sent to (joint.N.backlash-filt).",
    own_memory="COMP_FILE",
    own_reserve="COMP_FILE",
    backlash="BACKLASH",
    axis_name="letter in [TRAJ] COORDINATES",
    units="[TRAJ] LINEAR_UNITS and ANGULAR_UNITS",
    words="motion.analog-out and motion.digital-in",
    start="Cycle Start",
    restart="restart of LinuxCNC",
    version="LinuxCNC version",
    controls="LinuxCNC 2.9",
    suffixes=".comp",
    program_suffix=".ngc",
    tables_suffix=".comp",
)
