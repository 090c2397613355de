"""The uMD quadrature counter: a laser's AquadB output read live over a serial line."""
