"""The register map, both directions, as pure functions: orders to registers, registers to readings.

Map version 3 is written in `docs/plc-mailbox-reference.md`; nothing here does I/O.
"""
