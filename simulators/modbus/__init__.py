"""A PLC with the table mailbox in front of the NCK double, served over Modbus TCP, Modbus RTU and memory://."""

from simulators.modbus.plc import Plc
from simulators.modbus.settings import PlcSettings
from simulators.modbus.station import PlcStation, make_station, running_station

__all__ = ["Plc", "PlcSettings", "PlcStation", "make_station", "running_station"]
