"""Machine model: the kinematic chain, its error motions, and their fitting."""
