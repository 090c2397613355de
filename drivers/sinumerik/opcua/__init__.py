"""The control over OPC UA: one Controller device and what it does there, from a push to a ground part.

The registry opens `device`; nobody else is called from outside. Meaning lives here, requests live in `device`.
"""
