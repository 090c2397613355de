"""Commands for who measures and grinds: run, measure, correct, grind, inspect, close."""
