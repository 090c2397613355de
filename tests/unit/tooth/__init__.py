"""Tests of what a run does for the tooth, without a machine."""
