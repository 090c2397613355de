"""What each instrument would read: poses, beams and the physics of interferometers."""

from simulators.optics.calibrator import RotaryReader, Turns
from simulators.optics.laser import Counts, LaserCounter
from simulators.optics.mountings import MotionSource, Mounting, OpticsBench
from simulators.optics.sensor import SensorReader, SensorReadings

__all__ = [
    "Counts",
    "LaserCounter",
    "MotionSource",
    "Mounting",
    "OpticsBench",
    "RotaryReader",
    "SensorReader",
    "SensorReadings",
    "Turns",
]
