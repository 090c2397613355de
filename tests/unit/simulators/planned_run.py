"""A grind without a control: the encoder positions of a planned run, for judges who ask what the truth would do."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import CellFile, Part
from simulators.grinding import Grinder, WorkPiece
from simulators.optics import OpticsBench
from simulators.truth import Pose, Truth

FloatArray = NDArray[np.float64]
Correction = Callable[[Mapping[str, FloatArray]], FloatArray]
INDEX_S = 0.5
RETRACT_MM = 10.0


class PlannedRun:
    """Every space in turn: indexed with C going down, fed in with X going up, one stroke up and one down.

    X works at -(centre distance) + ``x_mm``, C at -360 k / zc + ``c_deg``, an axis Y at ``dressing_mm``.
    ``corrections`` by axis letter give what is added to the encoder, in mm or deg, from the planned places of
    all axes: the tables of a control, say.
    """

    def __init__(
        self,
        cell: CellFile,
        part: Part,
        *,
        x_mm: float = 0.0,
        c_deg: float = 0.0,
        dressing_mm: float = 0.0,
        corrections: Mapping[str, Correction] | None = None,
        feed_mm_per_s: float = 50.0,
        overrun_mm: float = 9.0,
        start_s: float = 0.0,
    ) -> None:
        self._letters = {axis.name: axis.letter for axis in cell.axes}
        self._part = part
        self._fixed = {"X": x_mm - part.grinding.centre_distance_mm, "Y": dressing_mm}
        self._c_deg = c_deg
        self.dressing_mm = dressing_mm
        self._corrections = dict(corrections or {})
        self._half = 0.5 * part.gear.b + overrun_mm
        self._stroke_s = 2.0 * self._half / feed_mm_per_s
        self.start_s = start_s

    @property
    def end_s(self) -> float:
        """When it is done."""
        return self.start_s + self._part.gear.zc * self._space_s

    @property
    def _space_s(self) -> float:
        return INDEX_S + 2.0 * self._stroke_s

    def encoder(self, axis: str, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Encoder positions and travel senses (n,) at these times."""
        places = self._places(times)
        letter = self._letters[axis]
        extra = self._corrections.get(letter)
        position = places[letter] + (extra(places) if extra is not None else 0.0)
        return position, self._senses(letter, times)

    def _phase(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        since = np.clip(times - self.start_s, 0.0, self.end_s - self.start_s - 1e-9)
        space = np.floor(since / self._space_s)
        return space, since - space * self._space_s - INDEX_S

    def _places(self, times: FloatArray) -> dict[str, FloatArray]:
        space, since = self._phase(times)
        share = np.clip(since / self._stroke_s, 0.0, 2.0)
        height = self._half * (1.0 - 2.0 * np.abs(share - 1.0))
        turned = np.clip(2.0 * (since + INDEX_S) / INDEX_S, 0.0, 1.0)
        fed = np.clip(2.0 * (since + INDEX_S) / INDEX_S - 1.0, 0.0, 1.0)
        index = np.maximum(space - 1.0 + turned, 0.0)
        return {
            "X": self._fixed["X"] - RETRACT_MM * (1.0 - fed),
            "Y": np.full_like(times, self._fixed["Y"]),
            "Z": self._part.grinding.height_mm + height,
            "C": self._c_deg - 360.0 / self._part.gear.zc * index,
        }

    def _senses(self, letter: str, times: FloatArray) -> FloatArray:
        if letter == "Z":
            _, since = self._phase(times)
            return np.where((since >= 0.0) & (since < self._stroke_s), 1.0, -1.0)
        return np.full_like(times, -1.0 if letter == "C" else 1.0)


def ground(truth: Truth, part: Part, seat: Pose | None = None, **planned: object) -> WorkPiece:
    """The part that this machine grinds in a `PlannedRun` with these options, clamped as drawn or at `seat`."""
    run = PlannedRun(truth.cell, part, **planned)  # type: ignore[arg-type]
    grinder = Grinder(OpticsBench(truth, run), part, truth.cell.wheel, lambda: run.dressing_mm)
    work = grinder.load(run.start_s, seat)
    grinder.follow(run.end_s, whole=True)
    return work
