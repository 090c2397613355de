"""Axis motions for tests: straight lines between moments, as an instrument would meet them."""

from __future__ import annotations

import numpy as np


class Motion:
    """Each axis runs straight between (time, position) knots; it stands still before and after."""

    def __init__(self, **knots: list[tuple[float, float]]) -> None:
        self.knots = knots

    def encoder(self, axis: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moments, places = np.asarray(self.knots.get(axis, [(0.0, 0.0)])).T
        position = np.interp(times, moments, places)
        signs = np.sign(np.diff(places, prepend=places[0] - 1.0))
        for index in range(1, len(signs)):
            signs[index] = signs[index] or signs[index - 1]
        direction = signs[np.clip(np.searchsorted(moments, times, side="left"), 0, len(signs) - 1)]
        return position, direction.astype(np.float64)


def plain_cell(**changes: object) -> dict[str, object]:
    """The data of a cell without any error: X1, Z1, C1, a laser and a calibrator; changed as asked."""
    axes = [
        {"name": "X1", "letter": "X", "kind": "linear", "travel": [-500.0, 1500.0]},
        {"name": "Z1", "letter": "Z", "kind": "linear", "travel": [-10.0, 400.0]},
        {"name": "C1", "letter": "C", "kind": "rotary", "travel": [0.0, 360.0], "modulo": True},
    ]
    instruments = [
        {"kind": "umd", "name": "laser", "sense": 1},
        {"kind": "bridge", "name": "calibrator", "sense": 1, "remainder_deg": 0.0},
    ]
    setups = [
        {"component": "EXX", "axis": "X", "instrument": "laser", "optics": "linear", "dead_path_mm": 100.0},
        {"component": "EZZ", "axis": "Z", "instrument": "laser", "optics": "linear"},
        {"component": "ECC", "axis": "C", "instrument": "calibrator", "optics": "rotary"},
    ]
    base: dict[str, object] = {"name": "plain", "axes": axes, "instruments": instruments, "setups": setups}
    return base | changes
