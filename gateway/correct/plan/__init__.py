"""A machine's plan of tables and the proposal by it: each axis' own layer, the cross layer, products, their records.

Called by the workflow and the studies. The rule: grids and resolutions are the control's, limits those of the house;
what leaves as a table is a deviation in um or arcsec with the house's sign.
"""
