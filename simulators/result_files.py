"""Result files as the laser maker's capture program writes them: .rtl for lines, .rta for angles."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.truth import Weather

FloatArray = NDArray[np.float64]
ARCSEC_PER_MRAD = 180.0 * 3.6 / np.pi
NOT_CONNECTED = -10.0


@dataclass(frozen=True, slots=True)
class FileContent:
    """What a capture program knows when it saves: no machine datum, targets from its own zero.

    ``targets`` (m,) mm or deg; ``deviations`` (m, n, 2) um or arcsec, last axis + then - approach, NaN for
    a reading that was not taken.
    """

    targets: FloatArray
    deviations: FloatArray
    rotary: bool
    start: Weather
    end: Weather
    started: datetime
    ended: datetime
    expansion_ppm_per_k: float
    env_factors: tuple[float, float]
    machine: str = "YK7350B"
    serial: str = ""
    axis: str = "X"


def write_result(path: Path, content: FileContent) -> None:
    """Write the file; CR LF line ends, ANSI text, six decimals for targets, three for deviations and more."""
    path.write_bytes(result_text(content).encode("cp1252"))


def result_text(content: FileContent) -> str:
    """The file's text. Even passes are written in the order they were measured: downwards."""
    lines = [
        *_header(content),
        *_targets(content.targets),
        *_words(content),
        "RUNS::",
        f"Run-count:{2 * content.deviations.shape[1]}",
        "",
        *_deviations(content),
        *_environment(content),
        "EOF::",
        "",
    ]
    return "\r\n".join(lines)


def _header(content: FileContent) -> list[str]:
    kind = "rta" if content.rotary else "rtl"
    return ["HEADER::", f"File type  : {kind}", "Owner      : Renishaw", "Version no : 20.02.01", ""]


def _targets(targets: FloatArray) -> list[str]:
    rows = [targets[first : first + 5] for first in range(0, len(targets), 5)]
    return [
        "TARGET DATA::",
        "Filetype  : ISO",
        f"Target-count: {len(targets)}",
        "Targets :",
        *(" " + "  ".join(f"{target:.6f}" for target in row) for row in rows),
        "Flags: 0 0 2 0",
        "",
    ]


def _words(content: FileContent) -> list[str]:
    date = content.started.strftime("%d/%m/%Y")
    values = (
        ("Machine", content.machine),
        ("Serial No", content.serial),
        ("Date", date),
        ("By", ""),
        ("Axis", content.axis),
        ("Location", ""),
        ("TITLE", ""),
    )
    return ["USER-TEXT::", *(f"{key}: {value}" for key, value in values), ""]


def _deviations(content: FileContent) -> list[str]:
    lines = ["DEVIATIONS::", "Run Target Data:"]
    count = len(content.targets)
    for index in range(2 * content.deviations.shape[1]):
        repetition, approach = divmod(index, 2)
        order = range(count) if approach == 0 else range(count - 1, -1, -1)
        for target in order:
            value = float(content.deviations[target, repetition, approach])
            if not np.isnan(value):
                lines.append(f"{index + 1:3d}  {target + 1:3d}  {_written(value, content.rotary)}")
    return [*lines, ""]


def _written(value: float, rotary: bool) -> str:
    """um with three decimals in .rtl; mrad with six in .rta."""
    return f"{value / ARCSEC_PER_MRAD:.6f}" if rotary else f"{value:.3f}"


def _environment(content: FileContent) -> list[str]:
    start, end = content.start, content.end
    off = NOT_CONNECTED
    pairs = (
        ("Air temp", start.air_degc, end.air_degc, "0"),
        ("Air press", start.pressure_hpa / 10.0, end.pressure_hpa / 10.0, "1"),
        ("Air humid", start.humidity_pct, end.humidity_pct, "0"),
        ("Mat temp 1", start.material_degc, end.material_degc, "0"),
        ("Mat temp 2", off, off, "0"),
        ("Mat temp 3", off, off, "0"),
    )
    lines = [f"{key:<11}: {first:.6f} {last:.6f} {code}" for key, first, last, code in pairs]
    first, last = content.env_factors
    alpha = content.expansion_ppm_per_k
    times = " ".join(f'"{moment.strftime("%H:%M %b %d %Y")}"' for moment in (content.started, content.ended))
    return [
        "ENVIRONMENT::",
        *lines,
        f"Env factor : {first:.8f} {last:.8f}",
        f"Exp coeff  : {alpha:.6f} {alpha:.6f} 0",
        f"Date Time  : {times}",
        "Final Data : 0 0",
        "",
    ]
