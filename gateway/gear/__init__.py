"""The cycloid gear and its grinding: profile, actual flank, inspection values (mm, rad)."""
