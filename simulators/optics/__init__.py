"""What each instrument would read: poses, beams and the physics of interferometers."""

from simulators.optics.bench import Bench, MotionSource, Mounting
from simulators.optics.calibrator import RotaryReader, Turns
from simulators.optics.laser import Counts, LaserCounter
from simulators.optics.sensor import Readings, SensorReader

__all__ = [
    "Bench",
    "Counts",
    "LaserCounter",
    "MotionSource",
    "Mounting",
    "Readings",
    "RotaryReader",
    "SensorReader",
    "Turns",
]
