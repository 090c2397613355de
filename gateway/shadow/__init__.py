"""A corrected copy of somebody else's NC program: its moves read, the correction added to the commanded positions.

Called by the workflow. The rule: pure, text in and text out, mm and deg in machine coordinates; a word that is not
understood is refused by its line, never passed over.
"""
