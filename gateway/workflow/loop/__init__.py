"""Whole runs: the main job on a site, and the closing run from all errors to the part that proves it."""
