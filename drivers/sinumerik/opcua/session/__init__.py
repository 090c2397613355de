"""One OPC UA session: connection, certificates, requests, files, alarms, and what a value of the control must be.

Called by the rooms of `opcua` alone. It knows asyncua and no tables; every error of asyncua is mapped here.
"""
