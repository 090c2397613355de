"""A reducer on a test bench, by mechanics alone: what its encoders read while it turns and while it is twisted."""
