"""Tests of the kinematic chain."""
