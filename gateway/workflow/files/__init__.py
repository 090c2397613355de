"""Workflows on files alone: strangers' results into the store, measured results out of it."""
