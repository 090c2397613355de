"""From runs of single error motions to ISO 230-1 letters: straightness, squareness, angles, location of an axis.

Called by the workflow through `errormodel`, which puts all set-ups together. The rule: deviations are the axis' motion
against the artefact, right-handed; a slope is a squareness or a mounting and stands in no error motion.
"""
