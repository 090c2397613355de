"""Straightness and angle instruments and the gear inspection machine on their wires."""

from simulators.sensing.gear import GearAnswerer
from simulators.sensing.stream import SensorAnswerer

__all__ = ["GearAnswerer", "SensorAnswerer"]
