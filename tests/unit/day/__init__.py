"""A calibration day from its folder of files."""
