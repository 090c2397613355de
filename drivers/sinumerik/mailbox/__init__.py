"""The PLC mailbox of docs/plc-mailbox.md as numbers: registers, commands, CRC and pictures, in both directions."""
