"""Commands that meet a machine: run, measure, correct, grind, inspect, push, rollback, doctor, acceptance."""
