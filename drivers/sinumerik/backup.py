"""NC blocks that write live tables, switches and backlash of an axis to a file, loadable as a program.

WRITE appends one block to a file, DELETE removes the old one (Job Planning manual; signatures as in the
editor completion lists); STOPRE before, because system variables are read ahead of the axes else.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

_CEC_PARAMETERS = ("STEP", "MIN", "MAX", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO", "TYPE")


@dataclass(frozen=True, slots=True)
class Memory:
    """What the control reserved: EEC points of the axis' encoder (MD38000), CEC points by table (MD18342).

    ``axes`` are the machine axis names: a program can compare values of type AXIS, but not write them down.
    """

    eec_points: int
    cec_points: tuple[int, ...] = ()
    axes: tuple[str, ...] = ()


def blocks(path: str, axis: str, encoder: int, memory: Memory, failed: str) -> list[str]:
    """Blocks that write everything which moves ``axis`` to ``path``; they jump to ``failed`` if they cannot.

    They use the integers ERR and N, which the program must define. All reserved points are written, so
    that leftovers beyond the end of a table are on record too.
    """
    out = [f'DELETE(ERR,"{path}")', "STOPRE"]
    if memory.eec_points:
        out += _points(path, f"$AA_ENC_COMP[{encoder},", f",{axis}]", memory.eec_points, failed)
        names = (f"$AA_ENC_COMP_{name}[{encoder},{axis}]" for name in ("STEP", "MIN", "MAX", "IS_MODULO"))
        out += _values(path, names, failed)
    for table, points in enumerate(memory.cec_points):
        if points:
            out += _cross(path, table, points, memory.axes, failed)
    out += _values(
        path,
        (
            f"$MA_BACKLASH[{encoder},{axis}]",
            f"$MA_ENC_COMP_ENABLE[{encoder},{axis}]",
            f"$MA_CEC_ENABLE[{axis}]",
        ),
        failed,
    )
    return [*out, *_line(path, '"M17"', failed)]


def _cross(path: str, table: int, points: int, axes: tuple[str, ...], failed: str) -> list[str]:
    """One CEC table; a table that was never loaded (STEP 0) has no axes to name and is left out."""
    inner = _points(path, f"$AN_CEC[{table},", "]", points, failed)
    for name in (f"$AN_CEC_INPUT_AXIS[{table}]", f"$AN_CEC_OUTPUT_AXIS[{table}]"):
        for axis in axes:
            inner += [f"IF {name}=={axis}", *_line(path, f'"{name}=({axis})"', failed), "ENDIF"]
    names = [f"$AN_CEC_{name}[{table}]" for name in _CEC_PARAMETERS]
    names += [f"$SN_CEC_TABLE_ENABLE[{table}]", f"$SN_CEC_TABLE_WEIGHT[{table}]"]
    return [f"IF $AN_CEC_STEP[{table}]<>0", *inner, *_values(path, names, failed), "ENDIF"]


def _points(path: str, left: str, right: str, count: int, failed: str) -> list[str]:
    text = f'"{left}"<<N<<"{right}="<<{left}N{right}'
    return [f"FOR N=0 TO {count - 1}", *_line(path, text, failed), "ENDFOR"]


def _values(path: str, names: Iterable[str], failed: str) -> list[str]:
    return [block for name in names for block in _line(path, f'"{name}="<<{name}', failed)]


def _line(path: str, text: str, failed: str) -> list[str]:
    return [f'WRITE(ERR,"{path}",{text})', f"IF ERR<>0 GOTOF {failed}"]
