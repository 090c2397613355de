"""From what an interferometer or calibrator shows to lengths and angles: air, dead path, expansion, combined turns.

Called by capture and by whoever reads result files. The rule: each correction is made once, stands in the record
(`corrections`) with its coefficients, and is refused a second time; a missing sensor is an error, never a default.
"""
