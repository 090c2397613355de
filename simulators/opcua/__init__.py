"""The OPC UA server of a SINUMERIK control, in front of the simulated NCK.

asyncua provides the protocol. `sessions` answers services by identifier instead of by a node for each variable (a
control has millions), `address_space` says what identifiers mean, `methods` serves files and rights, `subscriptions`
samples variables and reports alarms, `quirks` contains what a test can switch while it runs.
"""

from simulators.opcua.quirks import ServerQuirks
from simulators.opcua.server import ServerSettings, SinumerikServer, running_server

__all__ = ["ServerQuirks", "ServerSettings", "SinumerikServer", "running_server"]
