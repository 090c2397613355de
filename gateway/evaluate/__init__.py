"""Standard evaluations and physical corrections: readings in, figures of the standards out; pure."""
