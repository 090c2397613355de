"""Capture: targets, settling, averaging, attribution; from a live instrument or a result file."""
