"""Whether a control is all right: one examination by levels, its signed sheet, and the comparison with the simulator.

`control` reads the road, `checks` adds what starts programs, moves and writes; `doctor`, `doctor accept` and the pytest
plugin that ships with it show the same results. `comparison` is `doctor compare`. Writes through the push's own
transaction.
"""
