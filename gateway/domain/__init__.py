"""Frozen records of a run: each stage takes some and makes the next, and all of them are stored."""
