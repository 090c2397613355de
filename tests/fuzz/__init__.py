"""Fuzzing of every parser of foreign bytes: `engine` searches, `targets` names the parsers with their seeds."""
