"""What commands, tables, mounting and doubts do to the flank, to first order, at every place of the wheel (mm, rad).

Called by the other rooms of `correct`, the studies and the workflow. The rule: linear in every value, checked against
the exact flank by tests; nothing here decides anything.
"""
