"""The grinding process seen on inspected gears: what of a deviation is wheel, dresser, set-up, axes, clamping or wear.

Called by the workflow and the library. The rule: pure, in um on the flank (+ = surplus material); files, devices and
controls are the caller's.
"""
