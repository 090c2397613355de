"""A simulated grinder with its control and instruments: each answers on a real wire, as a device does."""
