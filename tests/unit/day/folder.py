"""A made calibration day: 25 files of a machine of formulas, written by the public descriptions of their layouts.

Written here from the layouts alone, in the encodings and line ends that capture PCs leave behind: no writer of the
product has a part in it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gateway.evaluate.geometry.measurement import Measurement
from tests.unit.components.machine import ARCSEC, STOOD, Machine

DAY = "2026-11-20 09:15"


def rt(one: Measurement, kind: str, axis: str, title: str, factor: float = 1.0) -> str:
    """Text of an .rtl or .rta, its targets in lines of five; odd runs go up, even ones down."""
    count, runs = len(one.targets), one.deviations.shape[1]
    targets = [f"{place:.6f}" for place in one.targets]
    lines = ["HEADER::", f"File type  : {kind}", "Owner      : day", "Version no : 0", "", "TARGET DATA::"]
    lines += ["Filetype  : ISO", f"Target-count: {count}", "Targets :"]
    lines += ["  ".join(["", *targets[at : at + 5]]) for at in range(0, count, 5)]
    lines += ["Flags: 0 0 2 0", "", "USER-TEXT::", "Machine: YK-7350B", "Serial No: 4711", f"Date: {DAY}"]
    lines += ["By: Jürgen Weiß", f"Axis: {axis}", "Location: Halle 3", f"TITLE: {title}", ""]
    lines += ["RUNS::", f"Run-count:{2 * runs}", "", "DEVIATIONS::", "Run Target Data:"]
    for run in range(2 * runs):
        order = range(count) if run % 2 == 0 else range(count - 1, -1, -1)
        values = one.deviations[:, run // 2, run % 2] * factor
        lines += [f"{run + 1}    {at + 1}    {values[at]:.6f}" for at in order]
    lines += ["", "ENVIRONMENT::", "Air temp   : 20.337280 20.384956 0", "Air press  : 99.039005 99.049346 1"]
    lines += [
        "Air humid  : 46.954897 46.893887",
        "Mat temp 1 : 20.203292 20.321342 0",
        "Exp coeff  : 8.000000 8.000000 0",
    ]
    return "\n".join([*lines, "", "EOF::", ""])


def table(one: Measurement, names: str, separator: str = ",", comma: bool = False, unit: float = 1.0) -> str:
    """A table with a heading: target, direction, repetition, deviation."""
    rows = [names]
    for at, place in enumerate(one.targets):
        for run in range(one.deviations.shape[1]):
            for way, sign in enumerate("+-"):
                value = f"{one.deviations[at, run, way] * unit:.6f}"
                cells = (f"{place:.3f}", sign, str(run + 1), value)
                rows.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return "\n".join([*rows, ""])


def pos(one: Measurement) -> str:
    """Means in mm in the three blocks of an API .pos file."""
    up, down = (np.nanmean(one.deviations[:, :, way], axis=1) / 1000.0 for way in (0, 1))
    blocks = (("Bidirectional", (up + down) / 2.0), ("Forward Directional", up), ("Backward Directional", down))
    lines = ["Position Z1"]
    for title, values in blocks:
        lines += [f"Position {title} Avg Error"]
        lines += [f"{place:.4f} {value:.7f}" for place, value in zip(one.targets, values, strict=True)]
        lines += ["---"]
    return "\n".join([*lines, ""])


def made(folder: Path, machine: Machine, *, mrad: float = ARCSEC * 1e3) -> Path:
    """The day's folder: all 21 errors in 24 files, and a dynamic record."""
    folder.mkdir(parents=True, exist_ok=True)
    english, german = "target_mm,direction,repetition,deviation", "target_mm;direction;run;deviation"
    angle = machine.angle

    def put(name: str, text: str, encoding: str = "cp1252", end: str = "\r\n") -> None:
        (folder / name).write_bytes(text.replace("\n", end).encode(encoding))

    put("x_pos.rtl", rt(machine.length("EXX"), "rtl", "X", "as found"))
    put("Z1 linear.pos", pos(machine.length("EZZ")), "ascii", "\n")
    put("c.rta", rt(angle("ECC"), "rta", "C", "Rundtisch 0..360°", mrad))
    put("x-neigung.rta", rt(angle("EBX"), "rta", "X1", "Pitch (Nicken)", mrad), "utf-8-sig")
    put("x gieren.rta", rt(angle("ECX"), "rta", "X", "", mrad), "utf-16")
    put("EAX.csv", table(angle("EAX"), english + "_arcsec"), "utf-8", "\r")
    put("z tilt 1.rta", rt(angle("EAZ"), "rta", "Z", "EAZ", mrad), "cp1252", "\n")
    put("z tilt 2.rta", rt(angle("EBZ"), "rta", "Z", "um Y", mrad))
    put("Z_roll.csv", table(angle("ECZ"), german + "_urad", ";", comma=True, unit=ARCSEC * 1e6), "utf-8-sig")
    for name in ("EYX", "EZX"):
        put(f"{name}.csv", table(machine.length(name, slope=0.12), english + "_um"))
    put("Geradheit Z in X.csv", table(machine.length("EXZ", slope=-0.1), german + "_mm", ";", comma=True, unit=1e-3))
    put("straightness Z in Y.csv", table(machine.length("EYZ"), english + "_um"), "utf-8", "\n")
    for name in ("EXC", "EYC", "EZC"):
        put(
            f"spindle {name}.csv",
            table(machine.length(name, eccentric=10.0), "target_deg,direction,repetition,deviation_um"),
        )
    for name in ("EAC", "EBC"):
        put(f"spindle {name}.csv", table(angle(name, lean=6.0), "target_deg,direction,repetition,deviation_arcsec"))
    along_x, along_z = machine.square(0.8, 12.0)[:2]
    put("square B0Z X1.csv", table(along_x, english + "_um"))
    put("square B0Z Z1.csv", table(along_z, english + "_um"))
    for name in ("A0C", "B0C"):
        for one in machine.bar(name, 6.0):
            put(f"bar {name} {one.turned_deg:g} deg.csv", table(one, english + "_um"))
    (folder / "spindle.rtx").write_bytes(b"\x00" * 64)
    return folder


def answers(where: Path, folder: Path) -> Path:
    """What only people know of it, as they would have answered."""
    lines = ["[all]", 'unit = "mrad"', 'sense = "+"', "own_angle = 0.8"]
    for name in ("X1", "Z1", "C1"):
        lines += [f"[axes.{name}]", "datum = 0", 'direction = "+"']
    lines += ['[files."z tilt 2.rta"]', 'error = "EBZ"']
    for name in ("A0C", "B0C"):
        for at in (0, 180):
            lines += [f'[files."bar {name} {at} deg.csv"]', f"park = {{ C1 = {at}.0, X1 = {STOOD} }}"]
    where.write_text("\n".join([*lines, ""]), encoding="utf-8")
    assert len(list(folder.iterdir())) == 25
    return where
