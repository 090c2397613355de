"""From the known errors to corrections of the tooth: `outlook` and `part` over `plan` over `solve` over `flank`.

The workflow, the studies and the report call it. All of it is pure, in mm and rad; corrections q are added to the
command, and only `plan.records` turns them into the deviations d = -q that a control's table holds.
"""
