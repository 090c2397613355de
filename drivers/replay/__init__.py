"""Wire traces: what passed between a device and us, kept in a file, and played to the same driver again."""
