"""A PLC with the table mailbox in front of the simulated NCK, over Modbus TCP, Modbus RTU and memory://.

Written from docs/plc-mailbox-reference.md alone: it shares no constant with the driver. From the wire inwards:
`station` (listens) > `frames` (bytes and requests) > `plc` (process image and program cycle) > `commands` > `state`
(session, release, checks) > `table_access` (the NCK in mailbox units) > `registers` (the map).
"""

from simulators.modbus.plc import Plc
from simulators.modbus.settings import PlcSettings
from simulators.modbus.station import PlcStation, make_station, running_station

__all__ = ["Plc", "PlcSettings", "PlcStation", "make_station", "running_station"]
