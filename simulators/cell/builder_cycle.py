"""A grinding cycle of the machine's builder: not ours, written from Siemens' programming manual alone.

It grinds the cell's part otherwise than our program does: every seventh space next, C from one side by ACN, strokes in
one direction only, a roughing wheel for all spaces and then a finishing wheel, other feeds, three strokes of spark-out.
It adds R parameters of its own to the depth; its dressing program reads the wheel's place, as ours does. It asks for
work piece and wheels in its own words. Blocks are plain G code: G0, G1, FOR, SUPA, ACN, M0.
"""

from __future__ import annotations

from simulators.cellfile import CellFile, Part

CYCLE = "GRINDDISC"
X_NUMBER = 210
"""The R parameter that the cycle adds to its x, mm."""
CLAMP, REMOVE, WHEEL = "CLAMP WORKPIECE", "REMOVE WORKPIECE", "CHANGE TO WHEEL"
STEP = 7
ROUGH_MM, SPARK_OUT = 0.03, 3
FACE_CLEAR_MM, AWAY_MM = 9.0, 12.0


def cycle_path() -> str:
    """Where the control keeps it."""
    return f"/_N_MPF_DIR/_N_{CYCLE}_MPF"


def cycle_text(cell: CellFile, part: Part) -> str:
    """The program for the part of a cell. Raises ConfigError (E-CELL-AXIS) for a cell that lacks an axis."""
    x, z, c = (cell.axis(letter).name for letter in "XZC")
    spaces, height = part.gear.zc, part.grinding.height_mm
    depth, reach = part.grinding.centre_distance_mm, 0.5 * part.gear.b + FACE_CLEAR_MM
    step = next(one for one in range(STEP, spaces) if _coprime(one, spaces))
    above, below, away = height + reach, height - reach, -depth - AWAY_MM
    out = [
        "; disc cycle, two wheels, one-way strokes",
        "G500 D0 G90 G94 G60 G601",
        f"SUPA G0 {x}={away:.3f}",
        f"SUPA G0 {z}={above:.3f}",
        f'MSG("{CLAMP}")',
        "M0",
    ]
    for wheel, strokes, feed, target in (
        (1, 1, 1800, f"{-depth - ROUGH_MM:.3f}"),
        (2, 1 + SPARK_OUT, 2400, f"{-depth:.3f}+R{X_NUMBER}"),
    ):
        out += [
            f'MSG("{WHEEL} {wheel}")',
            "M0",
            'MSG("")',
            "S1350 M3",
            f"FOR R231=0 TO {spaces - 1}",
            f"R232=(R231*{step}) MOD {spaces}",
            f"SUPA G0 {c}=ACN(R232*360/{spaces})",
            f"FOR R233=1 TO {strokes}",
            f"SUPA G1 {x}={target} F2500",
            f"SUPA G1 {z}={below:.3f} F{feed}",
            f"SUPA G0 {x}={away:.3f}",
            f"SUPA G0 {z}={above:.3f}",
            "ENDFOR",
            "ENDFOR",
            "M5",
        ]
    return "\n".join([*out, f'MSG("{REMOVE}")', "M0", 'MSG("")', "M30", ""])


def _coprime(step: int, spaces: int) -> bool:
    """Whether going on by this many spaces comes to every one."""
    return len({number * step % spaces for number in range(spaces)}) == spaces
