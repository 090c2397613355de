"""What each instrument would read: poses, beams and the physics of interferometers."""

from simulators.optics.calibrator import CalibratorSamples, RotaryReader
from simulators.optics.interferometer import CounterSamples, LaserCounter, refractive_index
from simulators.optics.mountings import AxisWatcher, MotionSource, Mounting, OpticsBench, StopNoise, linear_length_mm
from simulators.optics.sensors import (
    HeadReader,
    SensorReader,
    SensorReadings,
    component_of,
    component_reading,
    line_of_sight,
    watched_axes,
)

__all__ = [
    "AxisWatcher",
    "CalibratorSamples",
    "CounterSamples",
    "HeadReader",
    "LaserCounter",
    "MotionSource",
    "Mounting",
    "OpticsBench",
    "RotaryReader",
    "SensorReader",
    "SensorReadings",
    "StopNoise",
    "component_of",
    "component_reading",
    "line_of_sight",
    "linear_length_mm",
    "refractive_index",
    "watched_axes",
]
