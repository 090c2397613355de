"""A simulated SINUMERIK 840D sl NCK: it executes NC programs, moves axes and contains compensation tables.

From outside to inside: `control` (panel, PLC signals, writes from outside) > `channel` (mode, program run) > `program`
(interpreter) > `fault_injection` > `machine` (axes, data, compensation, time) > `language` (text to syntax) > `values`,
`spec`, `switches`. It shares with the drivers only `drivers.sinumerik.legality`, the printed rules of the language.
"""

from simulators.nck.control import Nck
from simulators.nck.fault_injection import ForgottenMemory
from simulators.nck.machine.data import POWER_ON_LOCK, STOPPING, Alarm
from simulators.nck.spec import AxisSpec, NckRefusal, NckSpec
from simulators.nck.switches import OPEN, Switches

__all__ = [
    "OPEN",
    "POWER_ON_LOCK",
    "STOPPING",
    "Alarm",
    "AxisSpec",
    "ForgottenMemory",
    "Nck",
    "NckRefusal",
    "NckSpec",
    "Switches",
]
