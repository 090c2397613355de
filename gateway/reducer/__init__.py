"""The reducer that discs will make: loaded contact, transmission error, lost motion, stiffness and their uncertainty.

Who decides about tables, parts or pairs of discs may call it; it knows the gear and nothing of machines, runs or
files. Rule of the room: every figure that is stated comes from the full model (`contact`); the first order
(`firstorder`) ranks and optimises, and its difference is shown.
"""
