"""Test parts: grind one, inspect it, correct from it, guard a gear."""
