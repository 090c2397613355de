"""The control through the PLC mailbox of docs/plc-mailbox.md: one Controller device over Modbus TCP.

The registry opens `device`. What registers mean stands in `codec`; only `wire` knows pymodbus.
"""
