"""Positioning tests by ISO 230-2 and the other standards, from deviations (m, n, 2) to their parameters with U.

Called by capture (how many targets), the workflow and the command line (`registry.evaluate_by`). The rule: what the
readings do not allow is None and said in flags, never filled in; a figure names its standard, edition and certainty.
"""
