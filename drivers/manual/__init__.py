"""Readings that a person types: any display - a dial gauge, an autocollimator - and a keyboard, as an instrument."""
