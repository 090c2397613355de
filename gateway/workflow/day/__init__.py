"""A calibration day from its folder of files: what each file is, what only people know, set-ups, error model, report.

Called by the command `day` alone; `naming` and `sorting` are pure, `gathering` reads, `making` writes.
"""
