"""Solvers: the table values and set-up values that make the tooth best under limits, rounded, and what must remain.

Called by `plan`, `part` and the studies. The rule: a solver's first lines are its theory of operation; it names no axis
of a certain machine, raises where it finds no solution, and returns values that keep every limit.
"""
