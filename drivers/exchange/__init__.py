"""Corrections in the formats of other controls and programs; no format without a public description.

The registry loads them; whoever has tables or errors may call them. Each file says the page that describes the format,
the unit and the sign, and what no page settles. Only what a control reads back as the same numbers is written.
"""
