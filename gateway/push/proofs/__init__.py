"""How a sign is measured on a road of its own: stops, readings, and the step they show.

Only the sign proof comes here. Room rule: a proof visits stops and reads; what is loaded, and taken back, is not its.
"""
