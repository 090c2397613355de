"""Frozen records that cross a port: what a device tells the gateway and what the gateway hands it."""
