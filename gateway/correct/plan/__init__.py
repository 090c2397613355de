"""A machine's plan of tables and the proposal by it: each axis' own layer, the cross layer, products, their records.

Called by the workflow and the studies. The rule: grids and resolutions are the control's, limits are fixed;
what leaves as a table is a deviation in um or arcsec with the sign convention of docs/architecture.md.
"""
