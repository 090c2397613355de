"""Floors in C (`floors.c`), compiled where a compiler is; None where none is."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

SOURCE = Path(__file__).with_name("floors.c")


@cache
def library() -> Any:
    """The compiled functions; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    folder = tempfile.mkdtemp(prefix="floors-")
    try:
        made = Path(folder) / "floors.so"
        subprocess.run([compiler, "-O3", "-shared", "-fPIC", str(SOURCE), "-o", str(made), "-lm"], check=True)  # noqa: S603
        found = ctypes.CDLL(str(made))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    found.integers.restype = ctypes.c_size_t
    found.flank.restype = ctypes.c_int
    return found


def integers(data: bytes, most: int) -> np.ndarray:
    """Whole numbers of a text, at most ``most``."""
    out = np.empty(most, np.int64)
    count = library().integers(data, ctypes.c_size_t(len(data)), _at(out))
    return out[:count]


def flank(
    start: np.ndarray, change: np.ndarray, gear: np.ndarray, E: float, angle: float, theta: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Deviation (mm) of one space whose wheel stands at ``start`` + s ``change`` (3, 4); theta and z (N,)."""
    out = np.empty(theta.size)
    arrays = [np.ascontiguousarray(part, float) for part in (start, change, gear, theta, z)]
    first, second, data, at, heights = map(_at, arrays)
    number = ctypes.c_double
    library().flank(
        first, second, data, number(E), number(angle), ctypes.c_size_t(out.size), at, heights, number(1e-12), _at(out)
    )
    return out


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
