"""What repeated readings tell of an axis beyond a standard's figures: scatter, drift, fine structure, vibration.

Called by capture, the guard and the workflow's stages. The rule: estimates are robust (one reading out of line does no
harm), what is left out is listed, and words come as codes.
"""
