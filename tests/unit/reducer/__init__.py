"""Tests of the reducer."""
