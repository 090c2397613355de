"""What a doctor reads of a control's settings, before the first program: file length, limits of CEC, what survives.

Each is judged against what the site's tables ask. Data that a control does not show are said to be unknown.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from drivers.checks import CheckLine, WantedAxis, fine, unknown, wrong
from drivers.sinumerik.ncprogram.backup import Memory, Saving, kilobytes
from drivers.sinumerik.ncprogram.selftest import read_report

CEC_SWITCH = 41300
MOST_SAVED_DATA = 10
SUMS = {"mm": 0.2, "deg": 0.05}  # the largest value of a table that we write (docs/architecture.md, section 6)


class Patient(Protocol):
    """What is asked: a machine datum by its NC name (None when it cannot be read), and the reserved points."""

    async def datum(self, name: str) -> Any:
        """The value, or None."""
        ...


LONGEST_NUMBER = 999_999_999


async def judged(bed: Patient, memories: Sequence[tuple[WantedAxis, Memory]]) -> list[CheckLine]:
    """Every setting in turn, for axes whose reserved points are known."""
    if not memories:
        return [unknown("W-DOC-MEMORY-UNKNOWN", "written files")]
    axes = [axis for axis, _ in memories]
    cross = any(any(memory.cec_points) for _, memory in memories)
    lines = [*await file_length(bed, memories), *await free_memory(bed), *await kept_switch(bed, cross=cross)]
    lines += await cross_limits(bed, axes, cross=cross)
    return [*lines, *await diameter(bed), *await temperature(bed, axes)]


async def file_length(bed: Patient, memories: Iterable[tuple[WantedAxis, Memory]]) -> list[CheckLine]:
    """MD11420 against the largest file that a program of ours writes, and MD11422 (a power cut)."""
    given = [(axis, memory) for axis, memory in memories]
    needed = kilobytes(
        Saving("LIVE", LONGEST_NUMBER, axis=axis.name, encoder=axis.encoder, memory=memory) for axis, memory in given
    )
    limit = await bed.datum("$MN_LEN_PROTOCOL_FILE")
    if limit is None:
        return [unknown("W-DOC-FILE-LIMIT-UNKNOWN", "written files", needed_kb=needed)]
    fields = {"needed_kb": needed, "limit_kb": int(limit)}
    if int(limit) < needed:
        return [wrong("E-DOC-FILE-LIMIT", "written files", **fields)]
    mode = await bed.datum("$MN_PROTOCOL_FILE_MODE")
    if mode is not None and int(mode) & 1:
        return [wrong("E-DOC-FILE-LATE", "written files", mode=int(mode))]
    return [fine("W-DOC-FILE-LIMIT", "written files", **fields)]


async def free_memory(bed: Patient) -> list[CheckLine]:
    """MD18060: what is left for programs and for memory that somebody reserves.

    Its unit differs between controls and versions, so nothing is compared but whether there is any.
    """
    left = await bed.datum("$MN_INFO_FREE_MEM_STATIC")
    if left is None:
        return [unknown("W-DOC-FREE-UNKNOWN", "free memory")]
    enough = float(left) > 0.0
    return [(fine if enough else wrong)("W-DOC-FREE" if enough else "E-DOC-FREE", "free memory", left=int(left))]


async def kept_switch(bed: Patient, *, cross: bool) -> list[CheckLine]:
    """Whether SD41300, written by a program, outlives a reset (MD10710); of no matter without cross tables."""
    if not cross:
        return []
    listed = [await bed.datum(f"$MN_PROG_SD_RESET_SAVE_TAB[{place}]") for place in range(MOST_SAVED_DATA)]
    if all(number is None for number in listed):
        return [unknown("W-DOC-KEPT-UNKNOWN", "SD41300")]
    if CEC_SWITCH not in [int(number) for number in listed if number is not None]:
        return [wrong("E-DOC-NOT-KEPT", "SD41300")]
    return [fine("W-DOC-KEPT", "SD41300")]


async def cross_limits(bed: Patient, axes: Iterable[WantedAxis], *, cross: bool) -> list[CheckLine]:
    """MD32720 and MD32730 of each axis, where the control has cross tables."""
    lines = []
    for axis in axes if cross else ():
        largest = await bed.datum(f"$MA_CEC_MAX_SUM[{axis.name}]")
        fastest = await bed.datum(f"$MA_CEC_MAX_VELO[{axis.name}]")
        if largest is None or fastest is None:
            lines.append(unknown("W-DOC-CEC-UNKNOWN", "CEC limits", axis=axis.name))
            continue
        fields = {"axis": axis.name, "largest": largest, "fastest": fastest, "unit": axis.unit, "ask": SUMS[axis.unit]}
        enough = float(largest) >= SUMS[axis.unit] and float(fastest) > 0.0
        lines.append((fine if enough else wrong)("W-DOC-CEC" if enough else "E-DOC-CEC", "CEC limits", **fields))
    return lines


def self_tests(reports: Mapping[str, str | None]) -> list[CheckLine]:
    """What the last self-test of each axis said; ``reports`` are texts of its file by axis, None where none is."""
    lines = []
    for axis, text in reports.items():
        report = None if text is None else read_report(text, axis)
        if report is None:
            lines.append(unknown("W-DOC-NO-SELF-TEST", "self-test", axis=axis))
            continue
        fields = {"axis": axis, "date": report.date, "passed": len(report.passed)}
        if report.failed or not report.whole:
            missed = ", ".join(report.failed) or "its end"
            lines.append(wrong("E-DOC-SELF-TEST", "self-test", missed=missed, **fields))
        else:
            lines.append(fine("W-DOC-SELF-TEST", "self-test", **fields))
    return lines


async def diameter(bed: Patient) -> list[CheckLine]:
    """MD20100: which axis is programmed in diameters; our programs say DIAMOF."""
    name = await bed.datum("$MC_DIAMETER_AX_DEF")
    if name is None:
        return [unknown("W-DOC-DIAMETER-UNKNOWN", "diameters")]
    return [fine("W-DOC-DIAMETER", "diameters", axis=str(name).strip() or "no axis")]


async def temperature(bed: Patient, axes: Iterable[WantedAxis]) -> list[CheckLine]:
    """MD32750 and SD43900 to 43920: what else moves the axes by a table of its own."""
    lines = []
    for axis in axes:
        kind = await bed.datum(f"$MA_TEMP_COMP_TYPE[{axis.name}]")
        if kind is None:
            lines.append(unknown("W-DOC-WARMTH-UNKNOWN", "temperature", axis=axis.name))
            continue
        names = ("ABS_VALUE", "SLOPE", "REF_POSITION")
        read = [await bed.datum(f"$SA_TEMP_COMP_{name}[{axis.name}]") for name in names]
        shown = ", ".join("unknown" if value is None else f"{value:g}" for value in read)
        code = "W-DOC-WARMTH" if int(kind) else "W-DOC-NO-WARMTH"
        lines.append(fine(code, "temperature", axis=axis.name, kind=int(kind), values=shown))
    return lines
