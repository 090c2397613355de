"""A PLC with the table mailbox in front of the NCK double, served over Modbus TCP, Modbus RTU and memory://."""

from simulators.modbus.plc import Plc
from simulators.modbus.station import PlcStation, serving, station_of
from simulators.modbus.switches import PlcSettings

__all__ = ["Plc", "PlcSettings", "PlcStation", "serving", "station_of"]
