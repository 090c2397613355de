"""What each instrument would read: poses, beams and the physics of interferometers."""

from simulators.optics.calibrator import CalibratorSamples, RotaryReader
from simulators.optics.interferometer import CounterSamples, LaserCounter
from simulators.optics.mountings import MotionSource, Mounting, OpticsBench
from simulators.optics.sensors import SensorReader, SensorReadings

__all__ = [
    "CalibratorSamples",
    "CounterSamples",
    "LaserCounter",
    "MotionSource",
    "Mounting",
    "OpticsBench",
    "RotaryReader",
    "SensorReader",
    "SensorReadings",
]
