"""The OPC UA server of a SINUMERIK control, in front of the NCK double."""

from simulators.opcua.server import ServerSettings, SinumerikServer, running_server

__all__ = ["ServerSettings", "SinumerikServer", "running_server"]
