"""The cycloid disc, its grinding (first order and exact envelope), its inspection, and drift in the process (mm, rad).

Called by reducer, correction, studies and the workflow. The rule: `e > 0` is surplus material along the outward normal.
"""
