"""What is shown of a reading while others are to come: corrected, and within its U what the capture says at its end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.sensing import Ambient
from gateway.capture.corrections import from_live
from gateway.capture.live import capture_axis
from gateway.capture.rig import Rig, prove_sense
from gateway.live import Asked, LiveDeviation, Nobody, looked_on_by
from tests.unit.capture.double import LittleMachine
from tests.unit.capture.test_live import AXIS, PATIENCE

# Of air at 20 degC, 1013.25 hPa and 50 % by the table of the U.S. national institute of standards: 1 + 271.4e-6 or so;
# here from the textbook law of a gas, independent of the equation of the program.
INDEX_AT_20 = 271.38e-6
STEEL_PPM = 11.5
WARMER_K_PER_S = 0.4 / 600.0
# Where the optics stand: so near the first target that there is no dead path.
FROM_MM = -100.0


@dataclass
class Seeing(Nobody):
    """Keeps what was shown."""

    shown: dict[Asked, LiveDeviation] = field(default_factory=dict)
    stood: list[float] = field(default_factory=list)

    def stands(self, positions: Mapping[str, float]) -> None:
        self.stood.extend(positions.values())

    def taken(self, axis: str, stop: Asked, seen: LiveDeviation) -> None:
        assert axis == "X1"
        self.shown[stop] = seen
        assert self.stood[-1] == stop[0], "where the axis stands is told before its reading"


class Warm(LittleMachine):
    """Air and material at 23 degC, and warmer by the minute."""

    def degc(self, times: np.ndarray) -> np.ndarray:
        return 23.0 + WARMER_K_PER_S * times

    async def ambient(self) -> Ambient:
        now = float(self.degc(np.array([self.clock.now()]))[0])
        return Ambient(air_degc=now, pressure_hpa=1013.25, humidity_pct=50.0, material_degc=(now,), age_s=0.0)


def error_um(position: np.ndarray) -> np.ndarray:
    return 3.0 * np.sin(position / 17.0) + 0.05 * position


def test_the_plot_shows_what_evaluate_will_within_the_uncertainty_that_it_says() -> None:
    seeing = Seeing()

    async def main() -> tuple[np.ndarray, np.ndarray]:
        clock = LoopClock()
        clock.now()
        rng = np.random.default_rng(5)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            degc = machine.degc(times)
            index = 1.0 + INDEX_AT_20 * 293.15 / (273.15 + degc)
            length = (position - FROM_MM + error_um(position) / 1000.0) * (1.0 + STEEL_PPM * 1e-6 * (degc - 20.0))
            return index * length + rng.normal(0.0, 2e-5, position.shape)

        machine = Warm(clock, reads)
        rig = Rig(AXIS, machine, machine, clock, PATIENCE)
        proof = await prove_sense(rig)
        with looked_on_by(seeing):
            raw = await capture_axis(rig, proof)
        capture = from_live(AXIS, raw, proof, "nothing")
        return capture.targets, capture.deviations

    targets, stored = run_virtual(main)
    at = {round(float(target), 6): row for row, target in zip(stored, targets, strict=True)}
    assert len(seeing.shown) == stored.size
    truth = error_um(targets) - error_um(targets)[0]
    for (target, repetition, approach), seen in seeing.shown.items():
        assert seen.unit == "um"
        assert seen.expanded is not None
        final = at[round(target, 6)][repetition - 1, 0 if approach == 1 else 1]
        assert abs(seen.value - final) <= seen.expanded, (target, seen, final)
        assert abs(seen.value - np.interp(target, targets, truth)) <= seen.expanded
        assert seen.expanded < 2.0, "an uncertainty that says nothing vouches for nothing"
    raw_slope = _slope({stop[0]: 1000.0 * (one.raw - stop[0]) for stop, one in seeing.shown.items()})
    shown_slope = _slope({stop[0]: one.value for stop, one in seeing.shown.items()})
    assert raw_slope - shown_slope == pytest.approx(1000.0 * 3e-4, rel=0.1), "uncorrected it climbs by air and steel"


def _slope(points: dict[float, float]) -> float:
    """In um/mm."""
    return float(np.polyfit(list(points), list(points.values()), 1)[0])
